"""Random sequences of requests to the controller of a random arm among random obstacles, tick by tick."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arm.collision_shapes import Box, Capsule, Shapes
from lrm_math.arrays import Array
from lrm_math.collision.contact import Contact, ContactPermit
from lrm_math.collision.scene import Scene
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.model.model import Model, model_of
from lrmd.config import Config, load_config
from lrmd.control.state_machine import Mode
from lrmd.messages.codec import Message
from lrmd.messages.control import (
    ArmRequest,
    HoldRequest,
    JogRequest,
    LeaseRequest,
    MoveRequest,
    PayloadRequest,
    SceneCommand,
)
from lrmd.messages.surroundings import ContactEntry, ObstacleEntry, contacts_of
from lrmd.safety.collision_guard import CollisionGuard
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon
from tests.support.daemon.independent_distances import bodies_apart, link_frames
from tests.support.random_arms import random_arm

JOINTS, MARGIN = 6, 0.02
LEAD_TICKS = 30
"""Ticks for which the ramp may go on along a way whose request is over: until the next one branches off."""
NEAR = 0.015
"""m."""
RENEWAL = 20
"""Ticks between two renewals of the lease."""


def cluttered_arm(seed: int) -> Arm:
    """A random arm with a capsule along every link, and boxes around it; the margin is 20 mm."""
    rng = np.random.default_rng([seed, 1])
    arm = random_arm(seed, JOINTS)

    def near() -> tuple[float, float, float]:
        x, y, z = rng.normal(0, 0.04, 3).tolist()
        return x, y, z

    capsules = tuple(
        Capsule(f"capsule {frame}", frame, near(), near(), float(rng.uniform(0.005, 0.02))) for frame in range(1, 8)
    )
    boxes = tuple(
        Box(
            f"box {i}", tuple(rng.normal(0, 0.5, 3).tolist()), tuple(rng.uniform(0.05, 0.4, 3).tolist()),
            tuple(rng.uniform(-1.5, 1.5, 3).tolist()), in_base=bool(i % 2),
        )
        for i in range(int(rng.integers(1, 4)))
    )  # fmt: skip
    return replace(arm, shapes=Shapes(capsules, boxes, MARGIN))


def soft_model(arm: Arm, rng: np.random.Generator) -> Model:
    """The arm with springs in its joints."""
    stiffness = {f"compliance.joint{i}.k_rad_per_Nm": float(rng.uniform(0.0, 0.08)) for i in range(1, JOINTS + 1)}
    return model_of(arm, effects_at(arm, "compliance"), stiffness)


def configured(arm: Arm, faster: int = 1) -> Config:
    """The shipped configuration with another arm of six joints, and quick arming."""
    config = load_config(CONFIG)
    return replace(config, arm=arm, stagger=13_000_000, step=faster * config.step)


@dataclass(frozen=True)
class SequenceResult:
    """Smallest separations (m) of the commanded arm: when it was armed, in any tick since; requests carried out and
    refused. `leaks`: what came nearer than it may; `touched`: pairs that came nearer than others may, as permitted."""

    armed: float
    least: float
    accepted: int
    refused: int
    leaks: tuple[str, ...] = ()
    touched: int = 0

    @property
    def required(self) -> float:
        """The margin or, where it is smaller, the separation when armed (m)."""
        return min(MARGIN, self.armed)

    @property
    def kept(self) -> bool:
        """Whether the separation never fell below what is required; to 10 µm, for the ramp's whole nanoseconds."""
        return self.least >= self.required - 1e-5 and not self.leaks


class GuardedSequence:
    """A client without scruples: it steers towards obstacles, in steps of any size, and changes its mind."""

    def __init__(self, seed: int, faster: int = 1) -> None:
        """`faster`: the largest step of a pulse in a tick, as a multiple of that of the shipped configuration."""
        self.rng = np.random.default_rng(seed)
        self.arm = cluttered_arm(seed)
        self.scene, self.sim = Scene.of(self.arm), SimulatedDaemon(configured(self.arm, faster), seed)
        self.accepted = self.refused = 0
        self.visited: list[Array] = []
        self.permits: list[ContactPermit] = []
        self.told: list[tuple[ObstacleEntry, ...]] = []
        self.told_at: list[int] = []
        self.under_way: list[tuple[Contact, ...]] = []
        self.permitted_now: tuple[Contact, ...] = ()
        self.deploy()

    def run(self, requests: int = 14, contacts: bool = False) -> SequenceResult:
        """Arms somewhere and sends so many requests; `contacts`: some of them permit one, others tell of obstacles or
        of a load, and another client takes over."""
        touching = (self.touch, self.touch, self.touch, self.surround, self.surround, self.load, self.take_over)
        self.tick(30)
        self.token = self.leased()
        start = self.start()
        self.request(ArmRequest(lease=self.token, where="given", q_rad=self.named(start)))
        while self.sim.core.mode is Mode.ARMING:
            self.tick(1)
        assert self.sim.core.mode is Mode.ARMED, self.sim.core.why
        self.visited.clear()
        self.under_way.clear()
        self.told_at.clear()
        actions = (self.move, self.creep, self.jog, self.jog, self.redirect, self.hold, self.deploy)
        armed_at = self.commanded()
        for _ in range(requests):
            among = (*actions, *touching) if contacts else actions
            among[int(self.rng.integers(len(among)))]()
        return self.judged(armed_at)

    def judged(self, armed_at: Array) -> SequenceResult:
        """The law in every tick since the arm was armed somewhere (n,), rad, by distances that share no code with the
        guard's, and by the requests that were sent and carried out."""
        q, back = np.unique(np.array([armed_at, *self.visited]), axis=0, return_inverse=True)
        placed, back = link_frames(self.arm, q), back.reshape(-1)
        pairs = {frozenset(pair): apart for pair, apart in bodies_apart(self.arm, placed, (), MARGIN).items()}
        armed = min(float(apart[back[0]]) for apart in pairs.values())
        permitted = {permit.pair for permit in self.permits}
        least = min((float(apart.min()) for pair, apart in pairs.items() if pair not in permitted), default=np.inf)
        tips = placed[-1][back[1:], :3, 3]
        leaks = [
            words
            for pair in permitted & pairs.keys()
            for words in self.leaks(pair, pairs[pair][back[1:]], tips, min(MARGIN, armed))
        ]
        leaks += self.run_into(placed, back[1:])
        touched = sum(float(pairs[pair].min()) < min(MARGIN, armed) - 1e-5 for pair in permitted & pairs.keys())
        return SequenceResult(armed, least, self.accepted, self.refused, tuple(leaks), touched)

    def leaks(self, pair: frozenset[str], apart: Array, tips: Array, required: float) -> Iterator[str]:
        """Ticks in which a pair, `apart` (T,), m, came nearer than is required otherwise than as a request under way
        permits."""
        reached = required
        for tick in np.flatnonzero(apart < required - 1e-5):
            here = float(apart[tick])
            if here >= reached - 1e-5:
                continue
            allowed = {
                contact.permit
                for held in self.under_way[max(0, tick - LEAD_TICKS) : tick + 1]
                for contact in held
                if contact.permit.pair == pair
            }
            if not any(here >= -p.depth - 1e-5 and _inside(tips[tick], p) > -1e-5 for p in allowed):
                yield f"tick {tick}: {sorted(pair)} at {here * 1e3:.3f} mm"
            reached = min(reached, here)

    def run_into(self, placed: Array, back: Array) -> Iterator[str]:
        """Obstacles that came nearer than the margin, and than they were when they were told of, for frames of poses
        and the number of the pose in every tick."""
        known: dict[str, tuple[ObstacleEntry, list[list[int]]]] = {}
        for tick, number in enumerate(self.told_at):
            for entry in self.told[number]:
                _, spans = known.setdefault(repr(entry), (entry, []))
                if spans and spans[-1][-1] == tick - 1:
                    spans[-1].append(tick)
                else:
                    spans.append([tick])
        bare = replace(self.arm, shapes=replace(self.arm.shapes, boxes=()))
        for entry, spans in known.values():
            for span in spans:
                poses, at = np.unique(back[span], return_inverse=True)
                for pair, apart in bodies_apart(bare, placed[:, poses], [entry.built()], MARGIN).items():
                    ways = apart[at.reshape(-1)]
                    if entry.name in pair and ways.min() < min(MARGIN, float(ways[:LEAD_TICKS].min())) - 1e-5:
                        yield f"{pair} at {ways.min() * 1e3:.3f} mm from tick {span[0]} on"

    # ---- what it does

    def move(self) -> None:
        """A move of any size through one to three waypoints, waited for or not."""
        self.request_move(*(self.anywhere() for _ in range(int(self.rng.integers(1, 4)))))
        self.tick(int(self.rng.integers(1, 200)))

    def creep(self) -> None:
        """Short moves towards the nearest obstacle."""
        step = float(10.0 ** self.rng.uniform(-3.5, -1.0))
        for _ in range(8):
            self.request_move(self.commanded() + step * self.inward())
            self.tick(int(self.rng.integers(1, 30)))

    def jog(self) -> None:
        """A jog towards the nearest obstacle, or anywhere, renewed at any rate."""
        direction = self.inward() if self.rng.random() < 0.7 else self.rng.uniform(-1, 1, JOINTS)
        rates = float(self.rng.uniform(0.01, 0.28)) * direction / max(float(np.abs(direction).max()), 1e-12)
        for _ in range(int(self.rng.integers(1, 12))):
            self.request(JogRequest(lease=self.token, rate_rad_per_s=self.named(rates)))
            self.tick(int(self.rng.integers(1, 40)))

    def redirect(self) -> None:
        """Moves that follow each other before the one before has ended."""
        for _ in range(5):
            self.request_move(self.anywhere())
            self.tick(int(self.rng.integers(1, 25)))

    def hold(self) -> None:
        """Stops."""
        self.request(HoldRequest())
        self.tick(int(self.rng.integers(0, 4)))

    def touch(self) -> None:
        """Up to the margin of an obstacle, on with a permission for that pair or another, somewhere about the tip; then
        further without."""
        pairs = self.scene.names[len(self.scene.capsule_pairs) :].tolist()
        apart = self.all_separations(self.commanded()[None])[0, len(self.scene.capsule_pairs) :]
        chosen = int(apart.argmin())
        here = len(self.scene.capsule_pairs) + chosen
        for _ in range(6):
            now = self.all_separations(self.commanded()[None])[0, here]
            self.request_move(self.commanded() + (now - MARGIN) * self.inward(here) / self.slope(here))
            self.tick(int(self.rng.integers(5, 40)))
        first, second = pairs[chosen if self.rng.random() < 0.7 else int(self.rng.integers(len(pairs)))]
        tip = self.scene.frames(self.commanded()[None])[0, -1, :3, 3]
        low, high = tip - self.rng.uniform(0.0, 0.1, 3), tip + self.rng.uniform(0.001, 0.1, 3)
        entry = ContactEntry(
            first=first, second=second, low_m=low.tolist(), high_m=high.tolist(),
            depth_m=float(self.rng.uniform(-MARGIN, 0.02)), force_n=float(self.rng.uniform(0.0, 20.0)),
        )  # fmt: skip
        self.permits += [contact.permit for contact in contacts_of([entry])]
        for may_touch in ([entry], [entry], [entry], [], []):
            step = float(10.0 ** self.rng.uniform(-3.0, -1.5))
            self.request_move(self.commanded() + step * self.inward(here), may_touch=may_touch)
            self.tick(int(self.rng.integers(10, 120)))

    def surround(self) -> None:
        """Tells of obstacles: anywhere, before the arm, or where it is; or of fewer."""
        tip = self.scene.frames(self.commanded()[None])[0, -1, :3, 3]
        place = (tip + self.rng.normal(0.0, 10.0 ** self.rng.uniform(-2.0, -0.3), 3)).tolist()
        size = float(self.rng.uniform(0.01, 0.2))
        number = int(self.rng.integers(3))
        form: dict[str, Any] = {
            "box": {"size_m": [size, 2 * size, size], "rotation_rad": self.rng.uniform(-3, 3, 3).tolist()},
            "sphere": {"radius_m": size / 2},
            "capsule": {"end_m": self.rng.normal(0.0, 0.4, 3).tolist(), "radius_m": size / 3},
        }
        rows, columns = self.rng.integers(1, 6, 2).tolist()
        heights = (place[2] + self.rng.normal(0.0, 0.1, rows * columns)).tolist()
        form["heightfield"] = {
            "cell_m": float(self.rng.uniform(0.02, 0.2)), "columns": columns,
            "heights_m": [None if self.rng.random() < 0.1 else height for height in heights],
            "rotation_rad": (self.rng.normal(0.0, 0.3, 3)).tolist(),
        }  # fmt: skip
        kind = list(form)[int(self.rng.integers(len(form)))]
        if kind == "heightfield":
            place[2] = 0.0
        put = [ObstacleEntry(name=f"thing {number}", shape=kind, position_m=place, **form[kind])]  # type: ignore[arg-type]
        gone = self.rng.random() < 0.3
        self.request(
            SceneCommand(
                owner="x", put=[] if gone else put, remove=[f"thing {number}"] if gone else [],
                max_age_s=None if self.rng.random() < 0.5 else 2.0,
            )
        )  # fmt: skip
        self.tick(int(self.rng.integers(1, 60)))
        self.creep()

    def load(self) -> None:
        """Tells of a load during a move, too heavy or not, and moves on."""
        self.request_move(self.anywhere())
        self.tick(int(self.rng.integers(0, 60)))
        heavy = float(10.0 ** self.rng.uniform(-2.5, 0.3))
        mass = heavy if self.rng.random() < 0.8 else 0.0
        self.request(PayloadRequest(lease=self.token, payload_kg=mass, payload_centre_m=self.load_at()))
        self.creep()

    def take_over(self) -> None:
        """Another client takes the lease from the one whose contact was permitted; then both go on."""
        before = self.token
        self.touch()
        self.token, self.permitted_now = self.leased(), ()
        with suppress(LrmError):
            self.sim.core.handle(MoveRequest(lease=before, waypoints=[self.named(self.anywhere())]), self.sim.now)
            raise AssertionError("a lease that was taken moves the arm")
        self.creep()

    def deploy(self) -> None:
        """Another model, or none."""
        model = soft_model(self.arm, self.rng) if self.rng.random() < 0.4 else None
        self.sim.core.adopt_guard(CollisionGuard(self.scene, model), self.sim.now)

    # ---- what it needs for that

    def load_at(self) -> list[float]:
        """Where the centre of the next load is (m): where the arm file has it."""
        return [0.0, 0.0, 0.0]

    def start(self) -> Array:
        """A pose that is just clear of an obstacle, clear, within the margin, or in overlap."""
        poses, kind = self.rng.uniform(-1.5, 1.5, (60, JOINTS)), self.rng.random()
        if kind < 0.4 and len(near := self.beside_an_obstacle()):
            return near[0]
        apart = self.separations(poses)
        wanted = np.flatnonzero((apart > MARGIN) if kind < 0.7 else (apart > 0.0) & (apart < MARGIN))
        return poses[int(wanted[0]) if kind < 0.9 and len(wanted) else 0]

    def beside_an_obstacle(self) -> Array:
        """(K, n), poses in which an obstacle is the nearest, a little beyond the margin."""
        poses = self.rng.uniform(-1.5, 1.5, (600, JOINTS))
        apart, least = self.all_separations(poses), len(self.scene.capsule_pairs)
        obstacle = apart[:, least:].min(axis=1)
        room = apart[:, :least].min(axis=1, initial=np.inf)
        return poses[(obstacle > MARGIN) & (obstacle < MARGIN + NEAR) & (room > MARGIN + NEAR)]

    def anywhere(self) -> Array:
        """A pose at any distance from here."""
        turn = float(10.0 ** self.rng.uniform(-3.0, 0.3)) * self.rng.uniform(-1, 1, JOINTS)
        return np.clip(self.commanded() + turn, -1.7, 1.7)

    def inward(self, pair: int | None = None) -> Array:
        """Unit direction in which the separation of a pair, or the smallest one, falls fastest."""
        slope = self.gradient(pair)
        return -slope / max(float(np.linalg.norm(slope)), 1e-12)

    def slope(self, pair: int) -> float:
        """How fast the separation of a pair falls in that direction (m/rad)."""
        return max(float(np.linalg.norm(self.gradient(pair))), 1e-3)

    def gradient(self, pair: int | None) -> Array:
        """(n,), m/rad, of the separation of a pair, or of the smallest one."""
        here = self.commanded()
        beside = self.all_separations(here + 1e-4 * np.concatenate([np.eye(JOINTS), -np.eye(JOINTS)]))
        one = beside.min(axis=1) if pair is None else beside[:, pair]
        return np.asarray(one[:JOINTS] - one[JOINTS:]) / 2e-4

    def separations(self, q: Array) -> Array:
        """(N,), smallest separation (m) of the rigid arm in poses (N, n)."""
        return np.asarray(self.all_separations(q).min(axis=1))

    def all_separations(self, q: Array) -> Array:
        """(N, pairs), separations (m) of the rigid arm in poses (N, n)."""
        blocks = [q[i : i + 400] for i in range(0, len(q), 400)]
        return np.concatenate([self.scene.separations(self.scene.frames(b)) for b in blocks])

    def commanded(self) -> Array:
        """(n,), commanded angles (rad)."""
        return np.array(self.sim.core.angles(self.sim.ramp.position)[:JOINTS])

    def named(self, values: Array) -> dict[str, float]:
        """Values by joint."""
        return {f"joint{i}": float(value) for i, value in enumerate(values, start=1)}

    def leased(self) -> str:
        """The token of a new lease."""
        lease = self.sim.core.handle(LeaseRequest(action="acquire", holder="x", take=True), self.sim.now).lease
        return lease.token

    def request_move(self, *waypoints: Array, may_touch: Sequence[ContactEntry] = ()) -> None:
        """A move with any pace and speed."""
        self.request(
            MoveRequest(
                lease=self.token, waypoints=[self.named(np.clip(q, -1.7, 1.7)) for q in waypoints],
                pace="each" if self.rng.random() < 0.5 else "together", speed=float(self.rng.uniform(0.2, 1.0)),
                may_touch=list(may_touch),
            )
        )  # fmt: skip

    def request(self, request: Message) -> None:
        """Sends a request, as the API passes it on, most of the time after the ramp has read the last order."""
        if self.rng.random() < 0.9:
            self.sim.settle()
        try:
            self.sim.core.handle(request, self.sim.now)
        except LrmError:
            self.refused += 1
            return
        self.accepted += 1
        if isinstance(request, MoveRequest | JogRequest | HoldRequest):
            self.permitted_now = contacts_of(request.may_touch) if isinstance(request, MoveRequest) else ()

    def tick(self, ticks: int) -> None:
        """Lets time pass, and keeps the lease alive."""
        for _ in range(ticks):
            if self.sim.ticks % RENEWAL == 0 and hasattr(self, "token"):
                with suppress(LrmError):
                    self.sim.core.handle(LeaseRequest(action="renew", lease=self.token), self.sim.now)
            self.sim.tick()
            self.visited.append(self.commanded())
            self.under_way.append(self.permitted_now)
            if not self.told or self.told[-1] != self.sim.core.obstacles.entries:
                self.told.append(self.sim.core.obstacles.entries)
            self.told_at.append(len(self.told) - 1)


def _inside(tip: Array, permit: ContactPermit) -> float:
    """How far (m) a tip (3,) is inside the region of a permission."""
    return float(min(*(tip - np.array(permit.low)), *(np.array(permit.high) - tip)))
