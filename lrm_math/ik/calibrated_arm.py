"""The engine of the calibrated inverse, on which every method builds: a deployed model packed for the kernel, its
answers unpacked; all commands that reach a goal, the nearest to one, and nominal guesses."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np

from lrm_math.arm.arm import BASE, TOOL, Arm, Joint, Placement
from lrm_math.arrays import Array, Vector3
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.ik.answer import Branch, Nearest, NotConverged, distinct
from lrm_math.ik.goal import IkQuery
from lrm_math.ik.kernel.shared_library import KernelFound, kernel
from lrm_math.ik.nominal import NominalSolver
from lrm_math.ik.packed_arm import EquilibriumBatch, PackedArm
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.pieper import PieperForm, pieper_form
from lrm_math.kinematics.poses import poses_of
from lrm_math.kinematics.screw_axes import screw_axes_of
from lrm_math.model.deployed_model import under_gravity, with_load_at, with_offsets
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model

SLACK = 0.4
"""rad: the nominal solutions may break the limits by so much, since the commands then differ from them."""
FREE_STARTS = (10, 96)
"""Number of library poses from which goals that leave motion free are sought, at first and if that leads nowhere."""
SIDE_CHANGES = 3
AT_LIMIT = 1e-9
"""rad: a command this far beyond a limit is at the limit."""
ALIGNED = 1e-4
"""m/rad: where some joint motion moves the tool no faster, a solution is called singular."""
REACHED = 0.01
"""m: a goal that the nearest command misses by less is tried once more from there."""
RETRACTIONS = (0.0, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
"""Shares of the distance to the second joint by which goals beyond the nominal arm's reach are retracted."""
LINEARISATIONS, STEADY = 30, 1e-11
"""Most calls of the kernel for effects that it does not know; rad: change of the slots that ends them."""


@dataclass(frozen=True, slots=True)
class IkSolutions:
    """Commands that a method found, and its steps; `error`: m, before the final Newton's method, if it has one."""

    commands: tuple[Branch, ...]
    steps: int
    error: float | None = None

    @property
    def within(self) -> list[Branch]:
        """Commands within the limits."""
        return [command for command in self.commands if command.margin >= -AT_LIMIT]

    @property
    def beyond(self) -> list[Branch]:
        """Commands beyond, the least excess first."""
        return sorted((c for c in self.commands if c.margin < -AT_LIMIT), key=lambda command: -command.margin)


CancellationCheck = Callable[[], None]
"""Called now and then during a search; raises an error once the answer is not wanted any more."""


def uncancelled() -> None:
    """Lets a search go on."""


class Method(Protocol):
    """A method of the calibrated inverse."""

    @property
    def name(self) -> str:
        """Name in replies."""

    def find(
        self, arm: CalibratedArm, query: IkQuery, check_cancelled: CancellationCheck = uncancelled
    ) -> IkSolutions | NotConverged | None:
        """Commands for one goal; None where the method finds none. Raises what `check_cancelled` raises."""


@dataclass(frozen=True, eq=False)
class CalibratedArm(PackedArm):
    """A deployed model (see `deployed_model`) and what follows from it alone."""

    @cached_property
    def form(self) -> PieperForm | None:
        """The closed form of an arm that looks like this one."""
        return None if self.model.arm.mimics else pieper_form(screw_axes_of(equivalent_arm(self.model)))

    @cached_property
    def nominal_solver(self) -> NominalSolver:
        """Inverse of the nominal arm, limits widened by `SLACK`."""
        joints = (replace(j, lower=j.lower - SLACK, upper=j.upper + SLACK) for j in self.model.arm.joints)
        return NominalSolver.of(replace(self.model.arm, joints=tuple(joints)))

    def under_gravity(self, down: Vector3) -> CalibratedArm:
        """The arm where gravity's direction is known (a unit vector), by the seeds of this one: ready at once."""
        return self._alike(under_gravity(self.model, down))

    def with_load_at(self, centre: Vector3) -> CalibratedArm:
        """The arm where the load's centre is known (m), see `Arm.with_load_at`, by the seeds of this one."""
        return self._alike(with_load_at(self.model, centre))

    def with_offsets(self, added: Mapping[str, float]) -> CalibratedArm:
        """The arm with small amounts (rad, m) added to constant offsets, by the seeds of this one: ready at once."""
        return self._alike(with_offsets(self.model, added))

    def _alike(self, model: Model) -> CalibratedArm:
        other = CalibratedArm(model)
        vars(other).update({name: getattr(self, name) for name in ("form", "nominal_solver", "library")})
        return other

    def nominal_tool(self, q: Array) -> Array:
        """(4, 4), tool frame of the nominal arm at angles (n,); m."""
        return np.asarray(self.nominal_solver.frames(q[None])[0, -1])

    def branches(self, query: IkQuery) -> IkSolutions:
        """All branches of a pose; commands nearest to `near`, or to the middle of the limits, of any other goal."""
        arm, near = self.kernel(query.payload), query.near
        solutions, V = arm.search(query.goal, near or self.limits.middle, near, FREE_STARTS), arm.slots
        if self.complete:
            return IkSolutions(tuple(self._unpacked(solutions, query)), solutions.steps)
        states = [(np.array(x.slots[:V]), np.array(x.tau[:V])) for x in solutions.at[: solutions.count]]
        return IkSolutions(tuple(c for s, tau in states for c in self._corrected(query, s, tau)), solutions.steps)

    def _unpacked(self, solutions: KernelFound, query: IkQuery) -> list[Branch]:
        """The kernel's solutions."""
        n, V, out = self.packed.joints, self.packed.slots, []
        for at in solutions.at[: solutions.count]:
            detours = tuple(j for j, wrong in enumerate(at.detour[:n], 1) if wrong)
            free = at.free if query.goal.constraints >= n and 0.0 <= at.slope < ALIGNED else None
            side, slots = tuple(at.side[:n]), tuple(at.slots[:V])
            out.append(Branch(tuple(at.q[:n]), -at.excess - AT_LIMIT, -1, free, side, detours, slots))
        return out

    def at_goal(self, query: IkQuery, slots: Array) -> list[Branch]:
        """The command at the goal by Newton's method from slot amounts (V,); none if it does not lead there."""
        arm = self.kernel(query.payload)
        if not self.complete:
            return self._corrected(query, slots, arm.forward(slots[None])[1][0])
        state = arm.newton(query.goal, slots, query.near)
        return [] if state is None else self._unpacked(state[2], query)

    def _corrected(self, query: IkQuery, slots: Array, tau: Array) -> list[Branch]:
        """The command for a state near the goal, (V,) each: the kernel with the model linearised about it, repeatedly.

        Where effects without formula act on joints alone, the kernel's state is the model's, and stays.
        """
        joints = self.errors.moving.joints
        q, side, detour = self._command(query, slots, tau)
        for _ in range(LINEARISATIONS):
            zero, compliances = self.errors.linearised(poses_of(q, query.payload, side[None]), tau)
            by_springs = slots - self.errors.constants - self.errors.compliances @ tau
            about = self.kernel(query.payload).with_springs(zero, compliances)
            state = about.with_commands_off(q - by_springs[joints]).newton(query.goal, slots)
            if state is None:
                return []
            moved = float(np.abs(state[0] - slots).max())
            slots, tau, _ = state
            if moved > 0.0:
                q, side, detour = self._command(query, slots, tau)
            if moved < STEADY:
                break
        if not np.isfinite(q).all():
            return []
        branch = self.branch(q, slots, tuple(side.astype(int).tolist()), tuple((np.flatnonzero(detour) + 1).tolist()))
        return [branch._replace(friction=query.friction(q, side))]

    def branch(self, q: Array, slots: Array, direction: tuple[int, ...], detours: tuple[int, ...] = ()) -> Branch:
        """A command (n,) with its slot amounts (V,)."""
        angles = tuple(q.tolist())
        margin = min(self.limits.margins(angles))
        return Branch(angles, margin, direction=direction, detours=detours, slots=tuple(slots.tolist()))

    def _command(self, query: IkQuery, slots: Array, tau: Array) -> tuple[Array, Array, Array]:
        """Command (n,), sides of arrival, and 1 where coming straight from `near` contradicts them, else 0."""

        errors = self.errors
        unloaded = (slots - errors.constants)[errors.moving.joints]

        def command(side: Array) -> Array:
            poses = poses_of(unloaded, query.payload, side[None])
            return np.asarray(errors.command(poses, tau[None], slots[None], query.motion)[0])

        side = np.zeros(len(unloaded))
        q, wrong = command(side), side
        if query.near is None:
            return q, side, wrong
        side = np.sign(q - query.near)
        for change in range(SIDE_CHANGES):
            q = command(side)
            wrong = (np.sign(q - query.near) != side).astype(np.float64)
            if not wrong.any() or change == SIDE_CHANGES - 1:
                break
            side = np.where(wrong > 0.0, -side, side)
        return q, side, wrong

    def equilibria(
        self, payload: float, q: Array, direction: Array | None = None, start: Array | None = None,
        tolerance: float = 1e-9, friction: Array | None = None,
    ) -> EquilibriumBatch:  # fmt: skip
        """Equilibria of commands (K, n) from sides (K, n) with a payload (kg), those that there are.

        `start`: (K, V), slot amounts to begin with; None: those without loads. `tolerance`: m. `friction`: its states
        (K, n, E) on arrival; None: as after a long move.
        """
        return self._settled(self.kernel(payload), q, payload, direction, start, tolerance, friction)

    def tool_at(
        self, payload: float, q: tuple[float, ...], arrival: Branch, start: tuple[float, ...] | None = None
    ) -> list[float] | None:
        """Tool frame by columns, twelve numbers, of a command's equilibrium; None if it has none. `start`: slots.

        `arrival`: a command that is reached alike, from the same sides.
        """
        begin = self.unloaded_slots(np.array([q]))[0].tolist() if start is None else start
        direction, friction = arrival.direction, friction_of([arrival])
        if not self.complete:
            settled = self.equilibria(
                payload, np.array([q]), np.array([direction]), np.array([begin]), friction=friction
            )
            return settled.tcp[0].tolist() if len(settled.rows) else None
        n, arm, iterations = len(q), self.kernel(payload), ctypes.c_int()
        slots, tcp = (ctypes.c_double * arm.slots)(*begin), (ctypes.c_double * 12)()
        angles, side = (ctypes.c_double * n)(*q), (ctypes.c_int * n)(*direction)
        kernel().ik_settle(arm.address, 1, angles, side, 1e-9, slots, tcp, ctypes.addressof(iterations))
        return tcp[:] if iterations.value > 0 else None


def friction_of(branches: Sequence[Branch]) -> Array | None:
    """(K, n, E), states of friction of K commands; None: as after a long move."""
    return np.array([b.friction for b in branches]) if branches and branches[0].friction else None


def commands(arm: CalibratedArm, query: IkQuery) -> IkSolutions | None:
    """All branches that the seeds lead to, or commands nearest to `near`; None if no seed leads to the goal.

    Seeds are the branches of an equivalent arm's closed form, null-space and fold seeds, and poses of the library (see
    section 8 of `kernel/ik_kernel.c`). Where they lead to nothing within the limits, Newton's method starts from the
    nearest command, if it is within 1 cm, and from the nominal arm's branches.
    """
    if not arm.library.reach_ball.contains(query.goal.position):
        return None
    branches = arm.branches(query)
    if not branches.within:
        more = _from_elsewhere(arm, query, branches)
        branches = replace(branches, commands=tuple(distinct([*more, *branches.commands])))
    return branches if branches.commands else None


def _from_elsewhere(arm: CalibratedArm, query: IkQuery, solutions: IkSolutions) -> list[Branch]:
    """Newton's method from the nearest command to the goal, or else from the nominal arm's branches."""
    out: list[Branch] = []
    with suppress(LrmError):
        closest = nearest(arm, query, tuple(command.q for command in solutions.beyond))
        if closest.error <= REACHED:
            out = _from_commands(arm, query, [closest.q])
    branches = () if out else arm.nominal_solver.branches(query.goal, query.near)
    return out or _from_commands(arm, query, [branch.q for branch in branches])


def _from_commands(arm: CalibratedArm, query: IkQuery, starts: Sequence[tuple[float, ...]]) -> list[Branch]:
    settled = arm.equilibria(query.payload, np.array(starts).reshape(-1, arm.packed.joints))
    return distinct(command for slots in settled.slots for command in arm.at_goal(query, slots))


@lru_cache(maxsize=4)
def nearest(arm: CalibratedArm, query: IkQuery, starts: tuple[tuple[float, ...], ...] = ()) -> Nearest:
    """Least squares of distance (m) and scaled rotation over the commands within the limits.

    `starts`: commands (rad) to start from, beside the closest poses of the library. Of effects that the kernel does not
    know, the linear part decides about the command; its distance is that of the whole model, as `forward` states it: an
    overloaded arm may rest in several places.

    Raises `LrmError`: the arm does not settle anywhere near.
    """
    result = arm.kernel(query.payload).nearest(query.goal, starts)
    if result is not None:
        with suppress(NoEquilibrium):
            q = np.array([result[0]])
            side = np.zeros_like(q) if query.near is None else np.sign(q - query.near)
            friction = None if query.motion is None else np.array([query.friction(q[0], side[0])])
            settled = solve_equilibrium(arm.model, poses_of(q, query.payload, side, friction))
            return Nearest.at(result[0], query.goal, frames(arm.model.chain, settled.slots, 1)[0, -1])
    load = f" with {1e3 * query.payload:.0f} g" if query.payload else ""
    raise LrmError(f"the arm comes to rest in no pose near this goal{load}: too much load, or wrong compliances")


def initial_guesses(arm: CalibratedArm, query: IkQuery) -> Iterator[Array]:
    """Nominal solutions (n,), nearest to `near` first, or else furthest from the limits; a little beyond them too.

    Goals beyond the nominal arm's reach are retracted. What the goal leaves free of the orientation is as the guess has
    it. At last the closest poses of the library.
    """
    inwards = np.array(arm.nominal_solver.second_axis) - query.goal.position
    for share in RETRACTIONS:
        position = np.array(query.goal.position) + share * inwards
        goal = replace(query.goal, position=tuple(position.tolist()))
        branches = arm.nominal_solver.branches(goal, query.near)
        for branch in branches:
            yield np.array(branch.q)
        if branches:
            break
    offsets = arm.library.tcp[:, :3, 3] - query.goal.position
    for row in np.argsort(np.linalg.norm(offsets, axis=1))[:16]:
        yield arm.library.q[row]


def equivalent_arm(model: Model) -> Arm:
    """The arm with corrected angles and corrected nonzero lengths; further lengths would separate its axes.

    Where it has a closed form, that gives the seeds for Newton's method.
    """
    amounts = dict(zip((slot.key for slot in model.chain.slots), model.binding.constants, strict=True))

    def placed(place: str) -> Placement:
        return Placement(*(amounts[f"{place}.{name}"] for name in ("x", "y", "z", "alpha", "beta", "gamma")))

    def length(key: str, drawn: float | None) -> float | None:
        return amounts[key] if drawn else drawn

    def joint(place: str, drawn: Joint) -> Joint:
        d, a, extra_z = (length(f"{place}.{name}", getattr(drawn, name)) for name in ("d", "a", "extra_z"))
        turned = replace(drawn, theta=amounts[f"{place}.theta"], alpha=amounts[f"{place}.alpha"], beta=0.0)
        return replace(turned, d=d or 0.0, a=a or 0.0, extra_z=extra_z)

    joints = tuple(joint(f"joint{i}", drawn) for i, drawn in enumerate(model.arm.joints, 1))
    return replace(model.arm, base=placed(BASE), joints=joints, tool=placed(TOOL))
