"""Claims as a table for a terminal."""

from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from armgate.campaign.charts import number
from armgate.campaign.claims import Checked

_WORDS = {True: ("holds", "green"), False: ("does not hold", "bold red"), None: ("not decided", "dim")}


def claims_table(claims: Sequence[Checked]) -> Table:
    """Return the table."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    for head in ("claim", "goal", "value", ""):
        table.add_column(head, header_style="dim")
    for one in claims:
        sign = "≤" if one.config.at_most is not None else "≥"
        goal = "–" if one.goal is None else f"{sign} {number(one.goal)} {one.unit}".rstrip()
        value = "–" if one.value is None else f"{number(one.value)} {one.unit}".rstrip()
        table.add_row(Text(one.config.claim), goal, value, Text(*_WORDS[one.holds]))
    return table
