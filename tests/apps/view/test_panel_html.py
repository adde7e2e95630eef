import math

from armgate.apps.view import panel_html
from armgate.client import Entry


def entry(**more):
    return Entry.model_validate({"robot": "FR", "tick": 1, "time": 0.1, "q": (0.5, -2.9)} | more)


def test_a_robots_state_in_words():
    for more, word in (
        ({"stops": (3, 4), "holder": "leader"}, "stopped (3, 4)"),
        ({"link": "faulted"}, "link faulted"),
        ({"link": "waiting"}, "link waiting"),
        ({"link": "ready", "holder": "leader"}, "driven"),
        ({"link": "ready"}, "free"),
    ):
        assert panel_html.condition(entry(**more))[0] == word


def test_the_block_shows_holder_verdict_and_joints(description):
    verdict = {
        "seq": 1,
        "outcome": "refused",
        "cause": "clearance",
        "text": "FR/link_5 is 40 mm from GR/link_6",
    }
    html = panel_html.robot_html(
        description.robots[0], entry(holder="leader", verdict=verdict, least_clearance=0.123)
    )
    for part in ("leader", "refused: FR/link_5 is 40 mm", "123 mm", "28.6°", "-166.2°"):
        assert part in html
    assert "rgb(225, 140, 0)" in html  # A2 is near its limit
    assert "no command yet" in panel_html.robot_html(description.robots[0], entry())


def test_text_from_the_network_is_escaped(description):
    verdict = {"seq": 1, "outcome": "refused", "cause": "clearance", "text": '"><script>alert(1)</script>'}
    html = panel_html.robot_html(description.robots[0], entry(verdict=verdict))
    assert "<script>" not in html
    assert 'title="refused: &quot;&gt;&lt;script' in html
    assert "<b>" not in panel_html.note(("<b>",))
    assert "<b>" not in panel_html.banner("<b>", (0, 0, 0))


def test_units_of_joints(description):
    assert panel_html.shown(description.robots[0].joints[0], math.pi / 2) == "90.0°"
    assert panel_html.shown(description.robots[1].joints[0], 2.93) == "2.930 m"
