"""One model with one payload as the kernel reads it: packed once, immutable, checked against the fixed maxima."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_math.arrays import Array
from lrm_math.effects.field.residual_field import WAVES_ALONE
from lrm_math.errors import LrmError
from lrm_math.ik.goal import Goal
from lrm_math.ik.kernel.laws import KERNEL_LAWS, KernelLaw
from lrm_math.ik.kernel.shared_library import (
    MAX_BODIES,
    MAX_JOINTS,
    MAX_LAWS,
    MAX_POSES,
    MAX_SLOTS,
    MAX_SPRINGS,
    KernelArm,
    KernelFound,
    fits,
    kernel,
)
from lrm_math.kinematics.moving_slots import MovingSlots
from lrm_math.kinematics.pieper import PieperForm

Integers = NDArray[np.int32]
TWELVE = struct.Struct("12d").pack
DESCENTS, KEPT = 24, 4
"""Poses of the library from which descents to the nearest goal start, and how many of these go on to the end."""
BELOW = {
    "mimic": ("slots", 0), "leader": ("slots", 0),
    "joint": ("slots", 0), "other": ("slots", 0), "spring_load": ("slots", 0), "inboard": ("slots", 1),
    "counted": ("bodies", 1), "moved": ("bodies", 1), "law_joint": ("joints", 0), "axis": ("", 6),
    "law": ("", len(set(KERNEL_LAWS.values()))), "spring_from": ("", MAX_SPRINGS + 1),
    "term_axis": ("", 4), "field_axis": ("", 4), "term_factor": ("", WAVES_ALONE * MAX_JOINTS + 1),
}  # fmt: skip
"""Bounds of an array's indices into other arrays: a count of the arm's, and a number."""


@dataclass(frozen=True, eq=False)
class KernelModel:
    """A packed model. `memory`: the kernel's structure; `kept`: arrays that it points to."""

    memory: KernelArm
    moving: MovingSlots
    kept: tuple[NDArray[Any], ...] = ()

    @property
    def slots(self) -> int:
        """Number of moving slots."""
        return int(self.memory.slots)

    @property
    def joints(self) -> int:
        """Number of joints."""
        return int(self.memory.joints)

    @property
    def address(self) -> int:
        """Address of the structure."""
        return ctypes.addressof(self.memory)

    def _call(self, name: str, *arguments: Any) -> int:
        """Result of a function of the kernel for this arm; arrays and structures go by their addresses."""
        return getattr(kernel(), name)(self.address, *map(_address, arguments))  # type: ignore[no-any-return]

    def with_(self, **numbers: ArrayLike) -> KernelModel:
        """A copy with other numbers in some fields of the structure."""
        memory = KernelArm.from_buffer_copy(self.memory)
        for name, values in numbers.items():
            put(memory, name, values)
        return KernelModel(memory, self.moving, self.kept)

    def with_form(self, form: PieperForm | None) -> KernelModel:
        """A copy with a closed form: its own, or that of an arm like it."""
        out = self.with_()
        for name, values in (form or {}).items():
            put(out.memory.form, name, values)
        out.memory.has_form = form is not None
        return out

    def with_library(self, tcp: Array, q: Array, slots: Array) -> KernelModel:
        """A copy with seeds, M poses at rest: tool frames (M, 4, 4), commands (M, n), slot amounts (M, V)."""
        fits("library poses", len(q), MAX_POSES)
        columns = np.ascontiguousarray(frames_as_numbers(tcp[:, :3, 3], tcp[:, :3, :3]).T, dtype=np.float32)
        kept = (np.ascontiguousarray(q), np.ascontiguousarray(slots), columns)
        memory = self.with_(start=slots.mean(axis=0)).memory
        memory.poses, (memory.library_q, memory.library_slots, memory.library_columns) = len(q), map(_address, kept)
        return KernelModel(memory, self.moving, kept)

    def with_springs(self, zero: Array, compliances: Array) -> KernelModel:
        """A copy with other amounts without load (V,) and compliances (V, V), rad/N·m or m/N·m."""
        rows, columns = np.nonzero(compliances)
        fits("springs", len(rows), MAX_SPRINGS)
        counts = np.bincount(rows, minlength=len(zero)).cumsum()
        return self.with_(
            zero=zero, spring_from=[0, *counts.tolist()], spring_load=columns, spring=compliances[rows, columns]
        )

    def with_commands_off(self, shift: Array) -> KernelModel:
        """A copy whose residual field is that of commands `shift` (n,) beyond those by springs (rad)."""
        if not self.memory.terms:
            return self
        lower, upper = (np.array(ends[: self.joints]) for ends in (self.memory.field_lower, self.memory.field_upper))
        turn = self.memory.field_turn + shift[0]
        return self.with_(field_lower=lower - shift, field_upper=upper - shift, field_turn=turn)

    def forward(self, slots: Array) -> tuple[Array, Array]:
        """Tool frames (K, 4, 4) and gravity loads (K, V) at slot amounts (K, V)."""
        s = np.ascontiguousarray(slots, dtype=np.float64)
        tcp, tau = np.empty((len(s), 12)), np.empty(s.shape)
        self._call("ik_forward", len(s), s, tcp, tau, None)
        return matrices(tcp), tau

    def load_derivatives(self, slots: Array) -> Array:
        """(V, V), derivatives of the loads by the slots at amounts (V,)."""
        s, out = np.ascontiguousarray(slots, dtype=np.float64), np.empty((self.slots, self.slots))
        self._call("ik_load_derivatives", s, out)
        return out

    def settle(self, q: Array, side: Array, start: Array, tolerance: float) -> tuple[Array, Array, Integers]:
        """Equilibria of commands (K, n) that arrive from sides (K, n), from slot amounts (K, V).

        Returns amounts (K, V), tool frames (K, 12) by columns, iterations (K,), -1 where there is none.
        """
        commands, sides = np.ascontiguousarray(q, dtype=np.float64), np.ascontiguousarray(side, dtype=np.int32)
        slots, tcp, iterations = np.array(start, order="C"), np.empty((len(q), 12)), np.empty(len(q), dtype=np.int32)
        self._call("ik_settle", len(q), commands, sides, tolerance, slots, tcp, iterations)
        return slots, tcp, iterations

    def frames(self, slots: Array) -> Array:
        """(K, n + 2, 4, 4), frames of the base, after joint 1 … n, and of the tool, at slot amounts (K, V); m."""
        s, after = np.ascontiguousarray(slots, dtype=np.float64), np.empty((len(slots), self.slots + 1, 12))
        self._call("ik_forward", len(s), s, None, None, after)
        moved = matrices(after[:, self.moving.frame_inboard].reshape(-1, 12)).reshape(len(s), -1, 4, 4)
        return np.asarray(moved @ self.moving.frames)

    def cube(
        self, drawn: KernelModel, centre: Array, side: float, points: int, target: Array, tolerance: float, q: Array,
        slots: Array,
    ) -> tuple[Array, Array] | None:  # fmt: skip
        """The command (n,), of a cube of goals of the arm as drawn, whose equilibrium is nearest to `target` (3,), m.

        `centre`: (1, 12), frame by columns. `side`: m, of `points` goals. `q`, `slots`: a command (n,) and amounts (V,)
        at rest to begin with. `tolerance`: m, of the equilibria. Returns slot amounts too; None if there is none, as of
        an arm without a closed form.
        """
        if not drawn.memory.has_form:
            return None
        best, there, aim = np.array(q), np.array(slots), np.ascontiguousarray(target)
        seen_pose = self._call("ik_cube", drawn.memory, centre, side, points, aim, tolerance, best, there)
        return (best, there) if seen_pose else None

    def search(
        self, goal: Goal, towards: Sequence[float], near: Sequence[float] | None, starts: Sequence[int]
    ) -> KernelFound:
        """All branches of a pose; of a goal that leaves motion free commands nearest to `towards` (n,), rad.

        `starts`: numbers of poses of the library that the latter are sought from, each if the one before finds none.
        """
        result, here = KernelFound(), None if near is None else as_bytes(near)
        if goal.constraints == 6 and self.joints <= 6:
            self._call("ik_pose", goal_numbers(goal), here, result)
            return result
        for count in starts:
            if self._call("ik_free", goal_numbers(goal), goal.constraints, as_bytes(towards), here, count, result):
                break
        return result

    def hold(self, slots: Array, side: Array) -> tuple[Array, Array, Array] | None:
        """All slots (V,), loads (V,) and command (n,) with the joints at their amounts in slots (V,), each from a side.

        None if what the loads do to the other slots, or the command, does not settle.
        """
        s, sides = np.array(slots, dtype=np.float64), np.ascontiguousarray(side, dtype=np.int32)
        tau, q = np.empty(self.slots), np.empty(self.joints)
        return (s, tau, q) if self._call("ik_hold", sides, s, tau, q) else None

    def newton(
        self, goal: Goal, slots: Array, near: Sequence[float] | None = None
    ) -> tuple[Array, Array, KernelFound] | None:
        """Slots (V,) at the goal, from slots (V,), the loads, the command coming from `near`; None: not reached."""
        s, tau, result = np.array(slots), np.empty(self.slots), KernelFound()
        here = None if near is None else as_bytes(near)
        reached = self._call("ik_newton", goal_numbers(goal), goal.constraints, here, s, tau, result)
        return (s, tau, result) if reached else None

    def nearest(self, goal: Goal, starts: Sequence[Sequence[float]]) -> tuple[tuple[float, ...], Array] | None:
        """The nearest command (n,), rad, and the tool frame (4, 4) there; None if the arm does not settle.

        `starts`: commands to start from, beside the closest poses of the library.
        """
        result, more = KernelFound(), b"".join(map(as_bytes, starts))
        if not self._call(
            "ik_nearest", goal_numbers(goal), goal.constraints, DESCENTS, KEPT, len(starts), more, result
        ):
            return None
        tcp, _ = self.forward(np.array([result.at[0].slots[: self.slots]]))
        return tuple(result.at[0].q[: self.joints]), tcp[0]


def packed(
    moving: MovingSlots, moments: Array, reach: float, lower: Sequence[float], upper: Sequence[float]
) -> KernelModel:
    """An arm without springs, laws, closed form or library; limits (rad). Raises `LrmError` beyond a fixed maximum."""
    V, n, B = len(moving.slots), len(moving.joints), len(moving.inboard)
    for name, count, most in (
        ("moving slots", V, MAX_SLOTS),
        ("joints", n, MAX_JOINTS),
        ("bodies", B, MAX_BODIES),
        ("joints without a motor", len(moving.mimics), MAX_JOINTS),
    ):
        fits(name, count, most)
    counts = {"slots": V, "joints": n, "others": len(moving.others), "bodies": B, "mimics": len(moving.mimics)}
    memory = KernelArm(**counts, laws_known=1, reach=reach)
    turned = [not np.array_equal(fixed[:3, :3], np.eye(3)) for fixed in moving.fixed]
    return KernelModel(memory, moving).with_(
        gravity=moving.gravity, fixed=moving.fixed[:, :3].transpose(0, 2, 1), fixed_turn=turned, moment=moments,
        axis=moving.axes, joint=moving.joints, other=moving.others, inboard=moving.inboard,
        counted=moving.counted, moved=moving.moved, lower=lower, upper=upper,
        mimic=moving.mimics, leader=moving.leaders, ratio=moving.ratio,
    )  # fmt: skip


def with_laws(arm: KernelModel, laws: Sequence[KernelLaw], complete: bool) -> KernelModel:
    """The arm with joint laws; not `complete`: Python corrects commands, by no more than `nonlinear_bound`, rad."""
    fits("joint laws", len(laws), MAX_LAWS)
    p = np.zeros((len(laws), 4))
    for row, (_, _, values) in zip(p, laws, strict=True):
        row[: len(values)] = values
    out = arm.with_(law=[law for law, _, _ in laws], law_joint=[joint for _, joint, _ in laws], law_p=p)
    out.memory.laws, out.memory.laws_known = len(laws), complete
    return out


def put(memory: Any, name: str, values: ArrayLike) -> None:
    """Fills the beginning of a structure's array, or a number. Raises `LrmError` for what the kernel must not read."""
    flat = np.asarray(values).ravel()
    if not np.isfinite(flat).all():
        raise LrmError(f"the arm's {name} has a number that is not finite")
    if not isinstance(getattr(memory, name), ctypes.Array):
        setattr(memory, name, flat[0].item())
        return
    field = np.ctypeslib.as_array(getattr(memory, name))
    fits(f"numbers in {name}", flat.size, field.size)
    count, more = BELOW.get(name, ("", 0))
    below = more + (getattr(memory, count) if count else 0)
    if name in BELOW and flat.size and not 0 <= flat.min() <= flat.max() < below:
        raise LrmError(f"the arm's {name} has numbers from {flat.min()} to {flat.max()}; packed wrongly")
    field[: flat.size] = flat


def as_bytes(numbers: Sequence[float]) -> bytes:
    """Numbers as the kernel reads them."""
    return struct.pack(f"{len(numbers)}d", *numbers)


def goal_numbers(goal: Goal) -> bytes:
    """A goal as the kernel takes it: columns of the rotation (zeros where free) and position."""
    if goal.rotation is not None:
        (a, d, g), (b, e, h), (c, f, i) = goal.rotation
        return TWELVE(a, b, c, d, e, f, g, h, i, *goal.position)
    return TWELVE(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, *(goal.approach or (0.0, 0.0, 0.0)), *goal.position)


def frames_as_numbers(positions: Array, rotations: Array) -> Array:
    """(K, 12), goals as the kernel takes them, from positions (K, 3) in m and rotations (K, 3, 3)."""
    columns = rotations.transpose(0, 2, 1).reshape(-1, 9)
    return np.ascontiguousarray(np.concatenate([columns, positions], axis=1))


def matrices(tcp: Array) -> Array:
    """(K, 4, 4), homogeneous matrices of frames (K, 12) by columns."""
    out = np.zeros((len(tcp), 4, 4))
    out[:, :3] = tcp.reshape(-1, 4, 3).transpose(0, 2, 1)
    out[:, 3, 3] = 1.0
    return out


def _address(argument: Any) -> Any:
    """Address of an array or a structure; anything else as it is."""
    if isinstance(argument, np.ndarray):
        lent = argument.flags.writeable and argument.size  # a fifth of the time of `ctypes`, thirty times a query
        return ctypes.addressof(ctypes.c_byte.from_buffer(argument.data)) if lent else argument.ctypes.data
    return ctypes.addressof(argument) if isinstance(argument, ctypes.Structure) else argument
