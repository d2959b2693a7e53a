"""Pages made of templates: one file each, everything escaped, nothing left out silently."""

from __future__ import annotations

import json
import math
import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jinja2 import UndefinedError
from markupsafe import Markup

from gcs_tools.page import asset, render
from gcs_tools.watch.server import page as watch_page
from onboard.guidance.phases import Phase

SUMMARY: dict[str, Any] = {
    "verdict": "every flight passed",
    "flights": 1,
    "hours": 0.5,
    "confidence": 0.95,
    "columns": ("scenario",),
    "rows": [{"style": "total", "cells": ("quick",)}],
    "histograms": Markup("<svg></svg>"),
    "failures": [],
}


def data_of(page: str) -> Any:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


@pytest.mark.parametrize(
    "page",
    [
        render("report.html", flights=[]),
        render("watch.html", vehicle="v1"),
        render("summary.html", **SUMMARY),
    ],
)
def test_a_page_needs_nothing_from_elsewhere(page: str) -> None:
    assert page.startswith("<!doctype html>")
    assert page.count("</html>") == 1
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    for mark in ("{{", "}}", "{%", "/*style*/", "/*script*/"):
        assert mark not in re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)


@pytest.mark.parametrize("phase", Phase)
def test_every_phase_has_its_colour_in_both_themes(phase: Phase) -> None:
    light, dark = asset("page.css").split("@media (prefers-color-scheme: dark)")
    assert f"--phase-{phase}:" in light
    # What a theme does not change, it inherits.
    assert phase in {Phase.CRUISE, Phase.STANDBY} or f"--phase-{phase}:" in dark.split("}")[0]


def test_scripts_are_put_in_as_they_are_and_strict() -> None:
    page = render("report.html", flights=[])
    script = page[page.rindex("<script>") :]
    assert script.startswith('<script>"use strict";\n')
    assert script.count('"use strict";') == 1
    for name in ("map.js", "charts.js", "space.js", "report.js"):
        assert asset(name).removeprefix('"use strict";\n') in script


@given(st.text())
def test_any_text_in_the_data_is_read_back(text: str) -> None:
    text = text.encode(errors="replace").decode()
    assert data_of(render("report.html", flights=[{"name": text}])) == [{"name": text}]


def test_no_text_ends_the_data_early() -> None:
    evil = "</script><script>alert(1)</script><!--"
    page = render("report.html", flights=[{"name": evil}])
    assert evil not in page
    assert "<!--" not in page
    assert data_of(page)[0]["name"] == evil


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_numbers_that_json_lacks_are_an_error(value: float) -> None:
    with pytest.raises(ValueError, match="JSON"):
        render("report.html", flights=[{"height_m": value}])


def test_a_vehicle_s_name_is_text() -> None:
    page = watch_page("<b>uav</b> & co")
    assert "<b>uav</b>" not in page
    assert page.count("&lt;b&gt;uav&lt;/b&gt; &amp; co") == 2


def test_findings_are_text() -> None:
    failure = {"command": "clearway campaign <x>", "findings": "exception: a < b\n& more"}
    page = render("summary.html", **{**SUMMARY, "failures": [failure]})
    assert "<h3>clearway campaign &lt;x&gt;</h3>" in page
    assert "<pre>exception: a &lt; b\n&amp; more</pre>" in page
    assert "<svg></svg>" in page


def test_a_value_that_is_missing_is_an_error() -> None:
    with pytest.raises(UndefinedError, match="vehicle"):
        render("watch.html")
