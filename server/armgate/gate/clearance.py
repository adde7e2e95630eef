"""Clearance of occupancies: certified, for every timing, and as cheap as the near pairs are few.

For every pair a lower bound of the distance of the occupancies that the robots *hold* is kept, and the
direction that proved it. A new occupancy goes through four stages, each only for the pairs that the one
before left open:

1. the kept bound less the growth of the occupancy: Σ_j R_j·|C′ − C|_j, one product for all pairs;
2. the swept slab with the kept direction: no engine is asked while it still separates;
3. the engine, at the nodes that bind, for a new direction of the whole slab;
4. subdivision of both occupancies into cells, each with its own direction.

Stages 3 and 4 share one small budget per command. Used up, the pair counts as too near.
So does a pair whose bound is not a number.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armgate.cell.cell import Cell
from armgate.events import Joints
from armgate.gate.bounds import KeptBounds
from armgate.gate.certificate import Budget, Certifier
from armgate.gate.compiled import screen_of
from armgate.gate.groups import ChainGroup, Group, bounded, groups_of
from armgate.gate.question import Binding, Found, Question, halves, middle, ordered, segments
from armgate.gate.screen import MARGIN, robot_pairs
from armgate.gate.swept import Array, Index, Space, Swept

_SURVEY_BUDGET = 64
_DIRECTIONS = 2


@dataclass(frozen=True, slots=True)
class Judgement:
    """Lower bounds of a robot's P pairs for a new occupancy, (P,), or the first pair that binds it."""

    lb: Array
    binding: Binding | None


class Clearance:
    """Keeps what is proven of the held occupancies and judges new ones.

    Args:
        cell: The cell.
        compiled: Whether the screen is the compiled one; where that can be, if it is not said.
    """

    def __init__(self, cell: Cell, compiled: bool | None = None) -> None:
        self.cell = cell
        self.space = Space(cell)
        self.certifier = Certifier(cell)
        self.groups = [groups_of(self.space, i) for i in range(len(cell.robots))]
        pairs = [robot_pairs(gs, r.model.n) for gs, r in zip(self.groups, cell.robots, strict=True)]
        self.screen = screen_of(self.space, pairs, compiled)
        self.pairs_of = tuple(own.ids for own in pairs)
        self._place = [_places(gs) for gs in self.groups]
        self.limits = np.array([p.limit for p in cell.pairs])
        self.limits_of = tuple(self.limits[ids] for ids in self.pairs_of)
        self.bound = KeptBounds(self.pairs_of)
        self.watch()
        self.held: list[list[Swept]] = [[] for _ in cell.robots]
        self._n = np.tile(np.array([0.0, 0.0, 1.0]), (len(cell.pairs), 1))

    def fit(self, robot: int, places: Sequence[Joints], room: float) -> None:
        """Have motion bounds that hold for a robot within ``room`` of these positions, and of those between.

        What is kept stays: it was proven where the bounds held.
        """
        if self.space.fit(robot, places, room):
            self.groups[robot] = bounded(self.space, robot, self.groups[robot])
            self._place[robot] = _places(self.groups[robot])
            n = self.cell.robots[robot].model.n
            self.screen.replace(robot, robot_pairs(self.groups[robot], n))

    def growth(self, robot: int, step: Array) -> Array:
        """Returns by how much each of a robot's pairs can close when its joints move by ``step``."""
        return np.asarray(self.screen.pairs[robot].growth @ step)

    def watch(self) -> None:
        """Some bound may be below its limit: after a survey, or what was staged unjudged.

        What is judged keeps all limits where they are kept already, so it is enough to look until then.
        """
        self._watched = [True] * len(self.groups)

    def below(self, robot: int) -> list[int]:
        """Returns a robot's pairs whose kept bound does not reach their limit."""
        if not self._watched[robot]:
            return []
        near: list[int] = self.pairs_of[robot][~(self.bound.of(robot) >= self.limits_of[robot])].tolist()
        self._watched[robot] = bool(near)
        return near

    # --- the held occupancies ------------------------------------------------------------------------------

    def hold(self, robot: int, swept: Sequence[Swept]) -> None:
        """Reserves these occupancies for a robot; the kept bounds must already hold for them."""
        self.held[robot] = list(swept)
        self.screen.hold(robot, self.held[robot])

    def prove_held(self, robot: int, pair: int, budget: Budget) -> Binding:
        """Proves anew what can be proven of one pair of the held occupancies, and keeps the better bound."""
        group, k = self.find(robot, pair)
        lowest, points = np.inf, None
        for mine in self.held[robot]:
            found = self._pursue(Question(group, k, robot, mine, float(self.limits[pair])), budget)
            lowest, points = min(lowest, found.lb), ordered(group, k, found.points) or points
        self.bound[pair] = max(lowest, self.bound[pair])
        return Binding(pair, self.bound[pair], float(self.limits[pair]), points)

    def survey(self, robot: int) -> None:
        """Proves all pairs of a robot's held occupancies anew: at the start, or if what was held is void."""
        self.watch()
        proven = [self._proven(robot, group) for group in self.groups[robot]]
        self.bound.put(robot, np.concatenate([*proven, np.zeros(0)]))
        for pair in self.below(robot):
            if self.known(pair):
                self.prove_held(robot, pair, Budget(_SURVEY_BUDGET))

    def _proven(self, robot: int, group: Group) -> Array:
        """What kept and guessed directions prove of a group's held occupancies, (P,); the better are kept."""
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

    def known(self, pair: int) -> bool:
        """Says whether the positions of both bodies of a pair are known."""
        robots = (self.cell.bodies[k].robot for k in (self.cell.pairs[pair].a, self.cell.pairs[pair].b))
        return all(r is None or bool(self.held[r]) for r in robots)

    # --- a new occupancy -----------------------------------------------------------------------------------

    def judge(self, robot: int, new: Swept, step: Array | None, need: Array, budget: Budget) -> Judgement:
        """Judges a new occupancy of one robot against everything that the others hold.

        Args:
            robot: Its index.
            new: The occupancy to judge.
            step: By how much it extends the held one per joint; None if the kept bounds say nothing of it.
            need: The distance that each of its P pairs must keep, m, (P,).
            budget: Engine evaluations left for this command.
        """
        lb, left = self.screen.run(robot, new, step, need, (self.bound.of(robot), self._n))
        for place in left.tolist():
            pair, wanted = int(self.pairs_of[robot][place]), float(need[place])
            group, k = self.find(robot, pair)
            found = self._pursue(Question(group, k, robot, new, wanted), budget)
            lb[place] = max(found.lb, lb[place])
            if not lb[place] >= wanted:
                points = ordered(group, k, found.points)
                return Judgement(lb, Binding(pair, float(lb[place]), wanted, points))
        return Judgement(lb, None)

    def point_bound(self, robot: int, pair: int, q: Joints) -> float:
        """Returns a tight bound of one pair with the robot standing at ``q``, the others as they hold."""
        group, k = self.find(robot, pair)
        still = self.space.still(robot, q)
        sides = self._others(group, robot, still)
        return min(
            self.certifier.prove(group, k, still, side, (0, m)).lb
            for side in sides
            for m in range(len(side.R))
        )

    def names(self, pair: int) -> tuple[str, str]:
        """Returns the names of a pair's bodies."""
        p = self.cell.pairs[pair]
        return self.cell.bodies[p.a].name, self.cell.bodies[p.b].name

    # --- the stages ----------------------------------------------------------------------------------------

    def _slab(self, group: Group, robot: int, new: Swept, sel: Index, n: Array) -> Array:
        lb = [group.slab(new, side, sel, n)[0] for side in self._others(group, robot, new)]
        return np.asarray(np.min(lb, axis=0) - MARGIN)

    def _pursue(self, ask: Question, budget: Budget) -> Found:
        """Stages 3 and 4 for one pair: a new direction for the whole, then cells; the best bound found."""
        best = Found(-np.inf, None)
        n = self.kept_n(ask.group, ask.sel)
        for _ in range(_DIRECTIONS):
            at = self._binding_nodes(ask, n)
            if at is None or not budget.take():
                return best
            proof = self.certifier.prove(ask.group, ask.k, ask.new, *at)
            n = proof.n[None, :]
            lb = float(self._slab(ask.group, ask.robot, ask.new, ask.sel, n)[0])
            if lb > best.lb:
                self.keep_n(ask.group, ask.k, proof.n)
            best = Found(max(best.lb, lb), proof.points)
            if best.lb >= ask.need or not proof.lb - ask.loss(at[0]) >= ask.need:
                return best
        sides = self._others(ask.group, ask.robot, ask.new)
        proven = all(self._cells(ask, side, budget) for side in sides)
        return Found(ask.need, best.points) if proven else best

    def _binding_nodes(self, ask: Question, n: Array) -> tuple[Swept, tuple[int, int]] | None:
        """The other side's occupancy and the two nodes at which direction ``n`` separates least."""
        worst, at = np.inf, None
        for side in self._others(ask.group, ask.robot, ask.new):
            lb, mine, theirs = ask.group.slab(ask.new, side, ask.sel, n)
            if lb[0] < worst:
                worst, at = lb[0], (side, (int(mine[0]), int(theirs[0])))
        return at

    def _cells(self, ask: Question, side: Swept, budget: Budget) -> bool:
        """Halves segments until every cell of both occupancies is proven, one is not, or the budget ends."""
        other = [side.nodes] if ask.moving is None else segments(side.nodes)
        stack = [(a, b) for a in segments(ask.new.nodes) for b in other]
        while stack:
            a, b = stack.pop()
            if not budget.take():
                return False
            proof = self.certifier.prove(
                ask.group, ask.k, *self._cell(ask, side, middle(a), middle(b)), (0, 0)
            )
            if not proof.lb - ask.loss(side) >= ask.need:
                return False  # too near where it stands: smaller cells prove no more
            lb, _, _ = ask.group.slab(*self._cell(ask, side, a, b), ask.sel, proof.n[None, :])
            if not lb[0] - MARGIN >= ask.need:
                stack.extend(self._halve(ask, a, b))
        return True

    def _cell(self, ask: Question, side: Swept, a: Array, b: Array) -> tuple[Swept, Swept]:
        """Both sides over the nodes ``a`` and ``b`` only."""
        mine = self.space.sweep_nodes(ask.robot, a, ask.new.tube)
        if ask.moving is None:
            return mine, side
        return mine, self.space.sweep_nodes(ask.moving, b, side.tube)

    def _halve(self, ask: Question, a: Array, b: Array) -> list[tuple[Array, Array]]:
        """Halves the segment over which bodies travel farther."""
        way_a = float((self.space.motion[ask.robot] @ np.ptp(a, axis=0)).max())
        way_b = (
            0.0 if ask.moving is None else float((self.space.motion[ask.moving] @ np.ptp(b, axis=0)).max())
        )
        if way_a >= way_b:
            return [(half, b) for half in halves(a)]
        return [(a, half) for half in halves(b)]

    # --- who stands at the other side ----------------------------------------------------------------------

    def _others(self, group: Group, robot: int, new: Swept) -> list[Swept]:
        if group.other is None:
            return [self.space.static]
        return [new] if group.other == robot else self.held[group.other]

    def _between(self, group: Group, robot: int) -> Array:
        """Directions from centre to centre at the first node: a first guess for pairs far from each other."""
        mine = self.held[robot][0]
        side = self._others(group, robot, mine)[0]
        v = side.t[0, group.theirs] - mine.t[0, group.mine]
        if isinstance(group, ChainGroup):
            v = mine.t[0, group.theirs] - mine.t[0, group.mine]
            v = np.einsum("pji,pj->pi", mine.R[0, group.mine], v)
        length = np.linalg.norm(v, axis=1, keepdims=True)
        return np.where(length > MARGIN, v / np.maximum(length, MARGIN), np.array([0.0, 0.0, 1.0]))

    def find(self, robot: int, pair: int) -> tuple[Group, int]:
        """Returns the group of a robot's pair and its place there."""
        return self._place[robot][pair]

    def kept_n(self, group: Group, sel: Index) -> Array:
        """Returns the kept directions of some of a group's pairs, mine to theirs, (P', 3)."""
        return np.asarray(self._n[group.ids[sel]] * group.sign[sel, None])

    def keep_n(self, group: Group, k: int, n: Array) -> None:
        """Keeps a better direction for a group's k-th pair."""
        self._n[group.ids[k]] = n * group.sign[k]


def _places(groups: Sequence[Group]) -> dict[int, tuple[Group, int]]:
    """The group of each pair and its place there."""
    return {int(pair): (group, k) for group in groups for k, pair in enumerate(group.ids)}
