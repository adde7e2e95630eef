"""The description of the cell, and its assets."""

import hashlib
import math
from typing import Any

from armgate.conformance.case import case
from armgate.conformance.packing import Fields
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Unmet, check

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3}


def unique(names: list[str], what: str) -> None:
    """Check that no name stands twice."""
    twice = sorted({name for name in names if names.count(name) > 1})
    check(not twice, f"{what} named twice: {twice}")


async def described(trial: Trial) -> Fields:
    """The description, asked for anew."""
    wire = await trial.client("observer")
    return await wire.answered("describe", "description")


@case("DSC-1/describe", "Ask for the description", "At least one robot, each with joints")
async def _(trial: Trial) -> None:
    description = await described(trial)
    check(bool(description["robots"]), "a cell without robots")
    check(all(robot["joints"] for robot in description["robots"]), "a robot without joints")


@case("DSC-2/same", "Ask twice, on two connections", "The same description; lockstep as in welcome")
async def _(trial: Trial) -> None:
    first, second = await described(trial), await described(trial)
    for one in (first, second):
        one.pop("re", None)
    check(first == second, "two descriptions of one cell differ")
    check(first["lockstep"] == bool(trial.facts.welcome.get("lockstep")), "lockstep is not that of welcome")


@case(
    "DSC-4/names", "Look at all names", "Robots, bodies, and the joints of one robot have names of their own"
)
async def _(trial: Trial) -> None:
    description = await described(trial)
    unique([robot["name"] for robot in description["robots"]], "robots")
    unique([body["name"] for body in description["bodies"]], "bodies")
    for robot in description["robots"]:
        unique([joint["name"] for joint in robot["joints"]], f"joints of {robot['name']}")


@case(
    "DSC-5/lengths",
    "Compare start and states with the joints",
    "All are as long as the robot has joints",
    also=("STA-5",),
)
async def _(trial: Trial) -> None:
    description = await described(trial)
    for robot in description["robots"]:
        n = len(robot["joints"])
        check(
            len(robot["start"]) == n, f"{robot['name']} has {n} joints and a start of {len(robot['start'])}"
        )
        entry: Any = trial.entry(robot["name"])
        lengths = {key: len(entry[key]) for key in ("q", "setpoint", "stop_end") if entry[key] is not None}
        check(set(lengths.values()) <= {n}, f"{robot['name']} has {n} joints; its entry has {lengths}")


@case(
    "DSC-6/joints",
    "Look at units, limits and bounds",
    "Units by kind, lower not above upper, bounds positive",
)
async def _(trial: Trial) -> None:
    for robot in (await described(trial))["robots"]:
        check(robot["period"] > 0, f"{robot['name']} has the period {robot['period']}")
        for joint in robot["joints"]:
            name = f"{robot['name']}.{joint['name']}"
            check(
                joint["unit"] == ("rad" if joint["kind"] == "revolute" else "m"),
                f"{name}: unit {joint['unit']}",
            )
            check(joint["lower"] <= joint["upper"], f"{name}: lower above upper")
            bounds = [joint["velocity"], joint["acceleration"], joint["deceleration"]]
            check(all(bound is None or bound > 0 for bound in bounds), f"{name}: bounds {bounds}")


@case("DSC-7/bodies", "Look at the bodies", "Each names a robot of the cell and a link, or neither")
async def _(trial: Trial) -> None:
    description = await described(trial)
    robots = {robot["name"] for robot in description["robots"]}
    for body in description["bodies"]:
        both = (body["robot"] is None) == (body["link"] is None)
        check(both, f"{body['name']} names robot {body['robot']} and link {body['link']}")
        check(body["robot"] is None or body["robot"] in robots, f"{body['name']}: no robot {body['robot']}")


@case(
    "DSC-8/shapes", "Look at sizes and poses", "As many positive sizes as the kind asks for; unit quaternions"
)
async def _(trial: Trial) -> None:
    description = await described(trial)
    for body in description["bodies"]:
        sizes = body["shape"]["size"]
        good = len(sizes) == SIZES[body["shape"]["kind"]] and all(size > 0 for size in sizes)
        check(good, f"{body['name']}: {body['shape']['kind']} of {sizes}")
    poses = [(b["name"], b["xyz"], b["xyzw"]) for b in description["bodies"]]
    poses += [(r["name"], r["base_xyz"], r["base_xyzw"]) for r in description["robots"]]
    for name, xyz, xyzw in poses:
        check(len(xyz) == 3 and len(xyzw) == 4, f"{name}: {len(xyz)} and {len(xyzw)} numbers for a pose")
        check(abs(math.hypot(*xyzw) - 1) < 1e-6, f"{name}: a quaternion of length {math.hypot(*xyzw)}")


@case("DSC-9/urdf", "Fetch every URDF whole and check it", "Size and SHA-256 as described")
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    for robot in (await described(trial))["robots"]:
        ref, data = robot["urdf"], b""
        while len(data) < ref["size"]:
            chunk = await wire.answered("asset", "chunk", hash=ref["hash"], offset=len(data))
            check(
                bool(chunk["data"]) and chunk["offset"] == len(data),
                "a chunk that is empty, or from elsewhere",
            )
            check(chunk["total"] == ref["size"], f"total is {chunk['total']}, described are {ref['size']}")
            data += chunk["data"]
        check(
            hashlib.sha256(data).hexdigest() == ref["hash"], f"the URDF of {robot['name']} has another hash"
        )


@case("DSC-10/frames", "Look at tool and camera", "Both are among the frames of the robot")
async def _(trial: Trial) -> None:
    for robot in (await described(trial))["robots"]:
        for frame in filter(None, (robot["tool"], robot["camera"])):
            check(frame in robot["frames"], f"{robot['name']}: {frame} is no frame of it")


@case(
    "DSC-11/pieces",
    "Fetch pieces of an asset: the first byte, 100 from the middle, what is behind the end",
    "Exactly these",
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    ref = trial.facts.robot["urdf"]
    half = ref["size"] // 2
    whole = (await wire.answered("asset", "chunk", hash=ref["hash"]))["data"]
    for offset, length in ((0, 1), (half, 100), (ref["size"], 10), (ref["size"] - 1, 10)):
        chunk = await wire.answered("asset", "chunk", hash=ref["hash"], offset=offset, length=length)
        data = chunk["data"]
        check(chunk["offset"] == offset and chunk["hash"] == ref["hash"], "a piece of something else")
        check(
            len(data) <= length and (bool(data) or offset == ref["size"]),
            f"{len(data)} bytes of {length} from {offset}",
        )
        check(
            data == whole[offset : offset + len(data)] or offset >= len(whole), f"other bytes from {offset}"
        )


_STRANGE: dict[str, dict[str, Any]] = {"hash": {"hash": "0" * 64}, "offset": {"offset": 1 << 40}}

for _slug, _more in _STRANGE.items():

    @case(
        f"DSC-12/{_slug}",
        f"Ask for an asset with {_more}",
        "An unknown_asset, not fatal",
        also=("ERR-1", "ERR-2"),
    )
    async def _(trial: Trial, more: dict[str, Any] = _more) -> None:
        wire = await trial.client("observer")
        await wire.refused("asset", "unknown_asset", **({"hash": trial.facts.robot["urdf"]["hash"]} | more))
        await wire.in_step()


@case(
    "PAY-11/bounds",
    "Ask for the description, the URDFs and states",
    "Their maps, arrays, texts and depth are within the bounds",
    also=("PAY-19", "PAY-1", "MSG-1"),
)
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    await wire.answered("describe", "description")
    await wire.answered("asset", "chunk", hash=trial.facts.robot["urdf"]["hash"])
    await wire.answered("subscribe", "subscribed", every=1)
    for _ in range(5):
        await wire.hear(lambda m: m["type"] == "state", "a state")
    if wire.faults:
        raise Unmet(wire.faults[0])
