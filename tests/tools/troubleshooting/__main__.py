"""Write docs/troubleshooting.md: ``python -m tests.tools.troubleshooting``."""

from tests.tools.troubleshooting.page import PAGE, page

PAGE.write_text(page(), encoding="utf-8")
