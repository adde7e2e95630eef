"""``armgate report``: a run on one page."""

import re
from collections import Counter
from html.parser import HTMLParser

from support.clients import run


class Images(HTMLParser):
    def __init__(self):
        super().__init__()
        self.sources, self.linked = [], []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if tag == "img":
            self.sources.append(given["src"])
        self.linked += [given[key] for key in ("href", "src") if key in given and tag != "img"]


async def test_the_page_is_self_contained_and_shows_the_run(tmp_path):
    from armgate.audit.report import report_page
    from armgate.recording import Recording
    from support import records

    records.write(tmp_path, range(300))
    text = report_page(Recording.open(tmp_path))
    found = Images()
    found.feed(text)
    assert len(found.sources) == 3  # clearance, joints of A, signals
    assert all(source.startswith("data:image/png;base64,") for source in found.sources)
    assert found.linked == []
    assert "3.6 s" in text


async def test_the_command_writes_the_page_beside_the_recording(one_run):
    status, out, err = await run("report", one_run)
    assert (status, err) == (0, "")
    assert str(one_run / "report.html") in out
    text = (one_run / "report.html").read_text()
    assert "reason: the daemon is ending" in text
    assert "A: joints" in text
    assert "<td>commands</td><td>none<" in text
    assert re.search(r"<td>least clearance</td><td>[\d.]+ mm to others and surroundings; ", text)
    assert re.search(r"<td>stops</td><td>[1-9]", text)


def test_commands_are_counted_by_outcome():
    from armgate.audit.report import _outcome_counts

    assert _outcome_counts(Counter(admitted=3, refused=1)) == "4: 3 admitted, 0 limited, 1 refused"
