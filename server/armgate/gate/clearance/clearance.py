"""Clearance of occupancies: certified, for every timing, at a cost that depends on the near pairs only.

For every pair, a lower bound of the distance between the occupancies that the robots *hold* is kept, with the
direction that proved it. A new occupancy is checked in four stages, each only for the pairs that the
previous stage left open:

1. the kept bound less the growth of the occupancy: Σ_j R_j·|C′ − C|_j, one product for all pairs;
2. the swept slab with the kept direction: no engine is queried while it separates the pair;
3. an engine query at the binding nodes, for a new direction of the whole slab;
4. subdivision of both occupancies into parts, each with its own direction.

Stages 3 and 4 share one small budget per command. If it is used up, the pair counts as too near. So does a
pair whose bound is not a number.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armgate.cell.cell import Cell
from armgate.events import Joints
from armgate.gate.clearance.certificate import Budget, Certifier
from armgate.gate.clearance.compiled import prefilter_of
from armgate.gate.clearance.pair_bounds import PairBounds
from armgate.gate.clearance.pair_check import (
    Binding,
    PairBound,
    PairCheck,
    halves,
    in_pair_order,
    middle,
    segments,
)
from armgate.gate.clearance.pair_groups import ChainGroup, Group, pair_groups_of, with_present_bounds
from armgate.gate.clearance.prefilter import MARGIN, robot_pairs
from armgate.gate.clearance.swept import Array, Index, Space, Swept
from armgate.gate.occupancy import Occupancy

_PROVE_ALL_BUDGET = 64
_DIRECTIONS = 2


@dataclass(frozen=True, slots=True)
class ClearanceResult:
    """Lower bounds of a robot's P pairs for a new occupancy, (P,), and the first pair that binds, if any."""

    lb: Array
    binding: Binding | None


class Clearance:
    """Clearance of one cell: keeps the bounds of the held occupancies, and checks new occupancies.

    Args:
        cell: The cell.
        compiled: True for the compiled prefilter, False for numpy; by default compiled if numba is installed.
    """

    def __init__(self, cell: Cell, compiled: bool | None = None) -> None:
        self.cell = cell
        self.space = Space(cell)
        self.certifier = Certifier(cell)
        self.groups = [pair_groups_of(self.space, i) for i in range(len(cell.robots))]
        pairs = [robot_pairs(gs, r.model.n) for gs, r in zip(self.groups, cell.robots, strict=True)]
        self.prefilter = prefilter_of(self.space, pairs, compiled)
        self.pairs_of = tuple(own.ids for own in pairs)
        self._place = [_places(gs) for gs in self.groups]
        self.limits = np.array([p.limit for p in cell.pairs])
        self.limits_of = tuple(self.limits[ids] for ids in self.pairs_of)
        self.bound = PairBounds(self.pairs_of)
        self.mark_maybe_below()
        self.held: list[list[Swept]] = [[] for _ in cell.robots]
        self._n = np.tile(np.array([0.0, 0.0, 1.0]), (len(cell.pairs), 1))

    def fit(self, robot: int, positions: Sequence[Joints], margin: float) -> None:
        """Make a robot's motion bounds hold within ``margin`` of the hull of these positions.

        Kept bounds stay: they were proven for positions where the former motion bounds held.
        """
        if self.space.fit(robot, positions, margin):
            self.groups[robot] = with_present_bounds(self.space, robot, self.groups[robot])
            self._place[robot] = _places(self.groups[robot])
            n = self.cell.robots[robot].model.n
            self.prefilter.replace(robot, robot_pairs(self.groups[robot], n))

    def sweep(self, robot: int, occupancy: Occupancy) -> Swept:
        """Return a robot's occupancy as bodies in space, which `check` takes."""
        return self.space.sweep(robot, occupancy)

    def growth(self, robot: int, step: Array) -> Array:
        """Return the largest decrease of each of a robot's distances if its joints move by ``step``."""
        return np.asarray(self.prefilter.pairs[robot].growth @ step)

    def mark_maybe_below(self) -> None:
        """Record that a bound may be below its limit: all were proven anew, or a plan was staged unchecked.

        An occupancy that passes the check brings no further bound below its limit. So once no bound of a
        robot is below its limit, `below` need not compare until the next call of this method.
        """
        self._maybe_below = [True] * len(self.groups)

    def below(self, robot: int) -> list[int]:
        """Return a robot's pairs whose kept bound does not reach their limit."""
        if not self._maybe_below[robot]:
            return []
        near: list[int] = self.pairs_of[robot][~(self.bound.of(robot) >= self.limits_of[robot])].tolist()
        self._maybe_below[robot] = bool(near)
        return near

    # --- the held occupancies ------------------------------------------------------------------------------

    def hold(self, robot: int, swept: Sequence[Swept]) -> None:
        """Reserve these occupancies for a robot; the kept bounds must already hold for them."""
        self.held[robot] = list(swept)
        self.prefilter.hold(robot, self.held[robot])

    def prove_held(self, robot: int, pair: int, budget: Budget) -> Binding:
        """Prove one pair of the held occupancies anew, and keep the better bound."""
        group, k = self.find(robot, pair)
        lowest, points = np.inf, None
        for mine in self.held[robot]:
            found = self._prove(PairCheck(group, k, robot, mine, float(self.limits[pair])), budget)
            lowest, points = min(lowest, found.lb), in_pair_order(group, k, found.points) or points
        self.bound[pair] = max(lowest, self.bound[pair])
        return Binding(pair, self.bound[pair], float(self.limits[pair]), points)

    def prove_all(self, robot: int) -> None:
        """Prove all pairs of a robot's held occupancies anew: at the start, or if kept bounds are void."""
        self.mark_maybe_below()
        proven = [self._proven(robot, group) for group in self.groups[robot]]
        self.bound.put(robot, np.concatenate([*proven, np.zeros(0)]))
        for pair in self.below(robot):
            if self.positions_known(pair):
                self.prove_held(robot, pair, Budget(_PROVE_ALL_BUDGET))

    def _proven(self, robot: int, group: Group) -> Array:
        """Return the bounds of a group by kept and guessed directions, (P,); keep the better directions."""
        best = np.full(len(group.ids), -np.inf)
        if group.other is not None and not self.held[group.other]:
            return best
        every = np.arange(len(group.ids))
        for n in (self.kept_n(group, every), self._between(group, robot)):
            lb = np.min([self._slab(group, robot, mine, every, n) for mine in self.held[robot]], axis=0)
            better = lb > best
            self._n[group.ids[better]] = n[better] * group.sign[better, None]
            best = np.fmax(best, lb)
        return best

    def positions_known(self, pair: int) -> bool:
        """Return True if the positions of both bodies of a pair are known."""
        robots = (self.cell.bodies[k].robot for k in (self.cell.pairs[pair].a, self.cell.pairs[pair].b))
        return all(r is None or bool(self.held[r]) for r in robots)

    # --- a new occupancy -----------------------------------------------------------------------------------

    def check(
        self, robot: int, new: Swept, step: Array | None, need: Array, budget: Budget
    ) -> ClearanceResult:
        """Check a new occupancy of one robot against the occupancies that the others hold.

        Args:
            robot: Its index.
            new: The occupancy to check.
            step: Distance by which it extends the held one per joint; None if the kept bounds do not apply to
                it.
            need: The distance that each of its P pairs must keep, m, (P,).
            budget: Engine evaluations left for this command.
        """
        lb, left = self.prefilter.run(robot, new, step, need, (self.bound.of(robot), self._n))
        for place in left.tolist():
            pair, wanted = int(self.pairs_of[robot][place]), float(need[place])
            group, k = self.find(robot, pair)
            found = self._prove(PairCheck(group, k, robot, new, wanted), budget)
            lb[place] = max(found.lb, lb[place])
            if not lb[place] >= wanted:
                points = in_pair_order(group, k, found.points)
                return ClearanceResult(lb, Binding(pair, float(lb[place]), wanted, points))
        return ClearanceResult(lb, None)

    def point_bound(self, robot: int, pair: int, q: Joints) -> float:
        """Return a tight bound of one pair with the robot at ``q`` and the others in held occupancies."""
        group, k = self.find(robot, pair)
        still = self.space.still(robot, q)
        sides = self._others(group, robot, still)
        return min(
            self.certifier.prove(group, k, still, side, (0, m)).lb
            for side in sides
            for m in range(len(side.R))
        )

    def names(self, pair: int) -> tuple[str, str]:
        """Return the names of a pair's bodies."""
        p = self.cell.pairs[pair]
        return self.cell.bodies[p.a].name, self.cell.bodies[p.b].name

    # --- the stages ----------------------------------------------------------------------------------------

    def _slab(self, group: Group, robot: int, new: Swept, sel: Index, n: Array) -> Array:
        lb = [group.slab(new, side, sel, n)[0] for side in self._others(group, robot, new)]
        return np.asarray(np.min(lb, axis=0) - MARGIN)

    def _prove(self, check: PairCheck, budget: Budget) -> PairBound:
        """Run stages 3 and 4 for one pair: a new direction for the whole, then parts; return the bound."""
        best = PairBound(-np.inf, None)
        n = self.kept_n(check.group, check.sel)
        for _ in range(_DIRECTIONS):
            at = self._binding_nodes(check, n)
            if at is None or not budget.take():
                return best
            certificate = self.certifier.prove(check.group, check.k, check.new, *at)
            n = certificate.n[None, :]
            lb = float(self._slab(check.group, check.robot, check.new, check.sel, n)[0])
            if lb > best.lb:
                self.keep_n(check.group, check.k, certificate.n)
            best = PairBound(max(best.lb, lb), certificate.points)
            if best.lb >= check.need or not certificate.lb - check.loss(at[0]) >= check.need:
                return best
        sides = self._others(check.group, check.robot, check.new)
        proven = all(self._prove_parts(check, side, budget) for side in sides)
        return PairBound(check.need, best.points) if proven else best

    def _binding_nodes(self, check: PairCheck, n: Array) -> tuple[Swept, tuple[int, int]] | None:
        """Return the other side's occupancy and the two nodes at which direction ``n`` separates least."""
        worst, at = np.inf, None
        for side in self._others(check.group, check.robot, check.new):
            lb, mine, theirs = check.group.slab(check.new, side, check.sel, n)
            if lb[0] < worst:
                worst, at = lb[0], (side, (int(mine[0]), int(theirs[0])))
        return at

    def _prove_parts(self, check: PairCheck, side: Swept, budget: Budget) -> bool:
        """Halve segments until all parts are proven, a part cannot be proven, or the budget is used up."""
        other = [side.nodes] if check.moving is None else segments(side.nodes)
        stack = [(a, b) for a in segments(check.new.nodes) for b in other]
        while stack:
            a, b = stack.pop()
            if not budget.take():
                return False
            certificate = self.certifier.prove(
                check.group, check.k, *self._part(check, side, middle(a), middle(b)), (0, 0)
            )
            if not certificate.lb - check.loss(side) >= check.need:
                return False  # too near at this position, so smaller parts are too near as well
            lb, _, _ = check.group.slab(*self._part(check, side, a, b), check.sel, certificate.n[None, :])
            if not lb[0] - MARGIN >= check.need:
                stack.extend(self._halve(check, a, b))
        return True

    def _part(self, check: PairCheck, side: Swept, a: Array, b: Array) -> tuple[Swept, Swept]:
        """Return both sides over the nodes ``a`` and ``b`` only; for one chain both are this robot's part."""
        mine = self.space.sweep_nodes(check.robot, a, check.new.tube)
        if isinstance(check.group, ChainGroup):
            return mine, mine
        if check.moving is None:
            return mine, side
        return mine, self.space.sweep_nodes(check.moving, b, side.tube)

    def _halve(self, check: PairCheck, a: Array, b: Array) -> list[tuple[Array, Array]]:
        """Halve the segment over which bodies travel farther."""
        way_a = float((self.space.motion[check.robot] @ np.ptp(a, axis=0)).max())
        way_b = (
            0.0
            if check.moving is None
            else float((self.space.motion[check.moving] @ np.ptp(b, axis=0)).max())
        )
        if way_a >= way_b:
            return [(half, b) for half in halves(a)]
        return [(a, half) for half in halves(b)]

    # --- the other side, and directions --------------------------------------------------------------------

    def _others(self, group: Group, robot: int, new: Swept) -> list[Swept]:
        if group.other is None:
            return [self.space.static]
        return [new] if group.other == robot else self.held[group.other]

    def _between(self, group: Group, robot: int) -> Array:
        """Return directions from centre to centre at the first node: a first guess for distant pairs."""
        mine = self.held[robot][0]
        side = self._others(group, robot, mine)[0]
        v = side.t[0, group.theirs] - mine.t[0, group.mine]
        if isinstance(group, ChainGroup):
            v = mine.t[0, group.theirs] - mine.t[0, group.mine]
            v = np.einsum("pji,pj->pi", mine.R[0, group.mine], v)
        length = np.linalg.norm(v, axis=1, keepdims=True)
        return np.where(length > MARGIN, v / np.maximum(length, MARGIN), np.array([0.0, 0.0, 1.0]))

    def find(self, robot: int, pair: int) -> tuple[Group, int]:
        """Return the group of a robot's pair and its place in it."""
        return self._place[robot][pair]

    def kept_n(self, group: Group, sel: Index) -> Array:
        """Return the kept directions of some of a group's pairs, mine to theirs, (P', 3)."""
        return np.asarray(self._n[group.ids[sel]] * group.sign[sel, None])

    def keep_n(self, group: Group, k: int, n: Array) -> None:
        """Keep a better direction for a group's k-th pair."""
        self._n[group.ids[k]] = n * group.sign[k]

    @property
    def directions(self) -> Array:
        """The kept directions of all pairs, first body to second, (…, 3), for replacement in place."""
        return self._n


def _places(groups: Sequence[Group]) -> dict[int, tuple[Group, int]]:
    """Return the group of each pair and its place in it."""
    return {int(pair): (group, k) for group in groups for k, pair in enumerate(group.ids)}
