"""The pages of the report, the live view and a campaign's summary: templates, style, scripts.

Each page is one file that needs no network: styles and scripts are put into it.
"""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup


def render(template: str, **values: Any) -> str:
    """Return a page; every value is escaped unless it is `Markup`.

    Args:
        template: file name of the template in this package.
        values: that the template uses.

    Raises:
        UndefinedError: the template uses a value that is not given.
        ValueError: a value for ``tojson`` has a number that is not finite.
    """
    return _environment().get_template(template).render(**values)


def asset(name: str) -> str:
    """Return the text of a file in this package."""
    return resources.files(__name__).joinpath(name).read_text(encoding="utf-8")


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FunctionLoader(asset), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    # "<", ">" and "&" become escapes, so that text of a log cannot end the script element.
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    environment.globals.update(style=_style, scripts=_scripts)
    return environment


def _style(name: str) -> Markup:
    """Return a style sheet for use in a style element."""
    return Markup(asset(name))  # noqa: S704  our own file


def _scripts(*names: str) -> Markup:
    """Return several scripts as one, strict as a whole."""
    texts = [asset(name).removeprefix('"use strict";\n') for name in names]
    return Markup("\n".join(('"use strict";', *texts)))  # noqa: S704  our own files
