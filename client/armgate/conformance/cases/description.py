"""Description of the cell, and its assets."""

import hashlib
import math
from functools import partial
from typing import Any

from armgate.conformance.case import Violation, case, check
from armgate.conformance.codec import Fields
from armgate.conformance.context import CaseContext

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3}


def check_unique(names: list[str], what: str) -> None:
    """Check that no name occurs twice."""
    twice = sorted({name for name in names if names.count(name) > 1})
    check(not twice, f"two {what} have the same name: {twice}")


async def described(ctx: CaseContext) -> Fields:
    """Request and return the description."""
    client = await ctx.client("observer")
    return await client.call("describe", "description")


@case("DSC-1/describe", "Request the description", "At least one robot, each with joints")
async def cell_has_robots_with_joints(ctx: CaseContext) -> None:
    description = await described(ctx)
    check(bool(description["robots"]), "a cell without robots")
    check(all(robot["joints"] for robot in description["robots"]), "a robot without joints")


@case(
    "DSC-2/same", "Request the description on two connections", "The same description; lockstep as in welcome"
)
async def description_is_the_same_on_every_connection(ctx: CaseContext) -> None:
    first, second = await described(ctx), await described(ctx)
    for one in (first, second):
        one.pop("re", None)
    check(first == second, "two descriptions of one cell differ")
    check(
        first["lockstep"] == bool(ctx.server.welcome.get("lockstep")), "lockstep differs from that in welcome"
    )


@case("DSC-4/names", "Check all names", "Robots, bodies, and the joints of one robot have unique names")
async def names_in_the_description_are_unique(ctx: CaseContext) -> None:
    description = await described(ctx)
    check_unique([robot["name"] for robot in description["robots"]], "robots")
    check_unique([body["name"] for body in description["bodies"]], "bodies")
    for robot in description["robots"]:
        check_unique([joint["name"] for joint in robot["joints"]], f"joints of {robot['name']}")


@case(
    "DSC-5/lengths",
    "Compare start and states with the joints",
    "Each has one value per joint of the robot",
    also=("STA-5",),
)
async def positions_have_one_value_per_joint(ctx: CaseContext) -> None:
    description = await described(ctx)
    for robot in description["robots"]:
        n = len(robot["joints"])
        check(
            len(robot["start"]) == n, f"{robot['name']} has {n} joints and a start of {len(robot['start'])}"
        )
        entry: Any = ctx.entry(robot["name"])
        lengths = {key: len(entry[key]) for key in ("q", "setpoint", "stop_end") if entry[key] is not None}
        check(set(lengths.values()) <= {n}, f"{robot['name']} has {n} joints; its entry has {lengths}")


@case(
    "DSC-6/joints",
    "Check units, limits and bounds",
    "Units by kind, lower not above upper, bounds positive",
)
async def joints_have_matching_units_and_consistent_bounds(ctx: CaseContext) -> None:
    for robot in (await described(ctx))["robots"]:
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


@case("DSC-7/bodies", "Check the bodies", "Each names a robot of the cell and a link, or neither")
async def bodies_belong_to_a_link_of_a_robot_or_to_the_surroundings(ctx: CaseContext) -> None:
    description = await described(ctx)
    robots = {robot["name"] for robot in description["robots"]}
    for body in description["bodies"]:
        both = (body["robot"] is None) == (body["link"] is None)
        check(both, f"{body['name']} names robot {body['robot']} and link {body['link']}")
        check(body["robot"] is None or body["robot"] in robots, f"{body['name']}: no robot {body['robot']}")


@case(
    "DSC-8/shapes", "Check sizes and poses", "As many positive sizes as the kind requires; unit quaternions"
)
async def shapes_have_positive_sizes_and_poses_have_unit_quaternions(ctx: CaseContext) -> None:
    description = await described(ctx)
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
async def urdf_has_the_described_size_and_hash(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    for robot in (await described(ctx))["robots"]:
        ref, data = robot["urdf"], b""
        while len(data) < ref["size"]:
            chunk = await client.call("asset", "chunk", hash=ref["hash"], offset=len(data))
            check(
                bool(chunk["data"]) and chunk["offset"] == len(data),
                "a chunk that is empty, or has another offset",
            )
            check(
                chunk["total"] == ref["size"],
                f"total is {chunk['total']}, the described size is {ref['size']}",
            )
            data += chunk["data"]
        check(
            hashlib.sha256(data).hexdigest() == ref["hash"],
            f"the URDF of {robot['name']} has another hash than described",
        )


@case("DSC-10/frames", "Check tool and camera", "Both are among the frames of the robot")
async def tool_and_camera_are_frames_of_the_robot(ctx: CaseContext) -> None:
    for robot in (await described(ctx))["robots"]:
        for frame in filter(None, (robot["tool"], robot["camera"])):
            check(frame in robot["frames"], f"{robot['name']}: {frame} is not among its frames")


@case(
    "DSC-11/pieces",
    "Fetch pieces of an asset: the first byte, 100 from the middle, 10 beyond the end",
    "Exactly these bytes",
)
async def chunk_holds_the_requested_bytes(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    ref = ctx.server.robot["urdf"]
    half = ref["size"] // 2
    whole = (await client.call("asset", "chunk", hash=ref["hash"]))["data"]
    for offset, length in ((0, 1), (half, 100), (ref["size"], 10), (ref["size"] - 1, 10)):
        chunk = await client.call("asset", "chunk", hash=ref["hash"], offset=offset, length=length)
        data = chunk["data"]
        check(
            chunk["offset"] == offset and chunk["hash"] == ref["hash"],
            "a piece of another asset or with another offset",
        )
        check(
            len(data) <= length and (bool(data) or offset == ref["size"]),
            f"{len(data)} bytes of {length} from {offset}",
        )
        check(
            data == whole[offset : offset + len(data)] or offset >= len(whole), f"other bytes from {offset}"
        )


_UNKNOWN: dict[str, dict[str, Any]] = {"hash": {"hash": "0" * 64}, "offset": {"offset": 1 << 40}}


async def unknown_asset_is_refused(ctx: CaseContext, more: dict[str, Any]) -> None:
    client = await ctx.client("observer")
    await client.expect_refusal(
        "asset", "unknown_asset", **({"hash": ctx.server.robot["urdf"]["hash"]} | more)
    )
    await client.sync()


for _slug, _more in _UNKNOWN.items():
    case(
        f"DSC-12/{_slug}",
        f"Request an asset with {_more}",
        "An error unknown_asset, not fatal",
        also=("ERR-1", "ERR-2"),
    )(partial(unknown_asset_is_refused, more=_more))


@case(
    "PAY-11/bounds",
    "Request the description, the URDFs and states",
    "Their maps, arrays, texts and depth are within the bounds",
    also=("PAY-19", "PAY-1", "MSG-1"),
)
async def messages_are_within_the_payload_limits(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    await client.call("describe", "description")
    await client.call("asset", "chunk", hash=ctx.server.robot["urdf"]["hash"])
    await client.call("subscribe", "subscribed", every=1)
    for _ in range(5):
        await client.receive(lambda m: m["type"] == "state", "a state")
    if client.violations:
        raise Violation(client.violations[0])
