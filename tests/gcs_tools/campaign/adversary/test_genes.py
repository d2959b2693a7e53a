"""Named random numbers, which a search can move."""

from __future__ import annotations

import pytest

from gcs_tools.campaign.adversary.genes import SEARCHED, Genes, genes_of, genes_text
from gcs_tools.console.errors import CommandError


def test_a_gene_depends_on_the_seed_and_its_name_alone() -> None:
    first, again, other = Genes("a"), Genes("a"), Genes("b")
    assert first.value("x") == again.value("x")
    assert len({first.value("x"), first.value("y"), other.value("x")}) == 3


def test_a_moved_gene_replaces_the_drawn_one() -> None:
    genes = Genes("a", {"x": 0.25})
    assert genes.uniform("x", 10.0, 20.0) == 12.5
    assert genes.value("y") == Genes("a").value("y")


def test_every_option_can_be_chosen() -> None:
    options = ("a", "b", "c")
    found = [Genes("", {"x": value}).choice("x", options) for value in (0.0, 0.5, 1.0)]
    assert found == list(options)


def test_genes_are_written_and_read_exactly() -> None:
    moved = {"along_0": 0.1234, "late": 1.0}
    assert genes_of(genes_text(moved)) == moved
    assert genes_of("") == {}
    assert all(genes_of(f"{name}=0.5") for name in SEARCHED)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("speed=0.5", "--genes speed=0.5: unknown gene; expected along_0"),
        ("late=2", "--genes late=2: expected late=VALUE with a value from 0 to 1"),
        ("late", "--genes late: expected late=VALUE"),
        ("late=nan", "--genes late=nan: expected late=VALUE"),
    ],
)
def test_bad_genes_are_one_line(text: str, said: str) -> None:
    with pytest.raises(CommandError, match=said):
        genes_of(text)
