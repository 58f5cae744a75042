"""The lease under clients that die, wait, replay and forge: one commander, and no motion outlives its lease."""

from __future__ import annotations

from copy import deepcopy
from itertools import product

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from lrm_math.errors import LrmError
from lrmd.control.lease import LATE, TABLE, Lease, LeaseError, LeaseEvent, LeaseState
from lrmd.control.state_machine import Mode
from lrmd.messages.control import LEASE_LOST, ArmRequest, DisarmRequest, JogRequest, LeaseRequest, MoveRequest
from tests.support.daemon.in_memory_daemon import SimulatedDaemon

CLIENTS = st.sampled_from(["anna", "bruno", "carla"])
CYCLE = 3
"""Ticks between two cycles of the API."""


def acquire(sim: SimulatedDaemon, holder: str, **options) -> str:
    lease = sim.core.handle(LeaseRequest(action="acquire", holder=holder, **options), sim.now).lease
    return lease.token


def moving(config) -> tuple[SimulatedDaemon, str]:
    """A daemon whose client has just begun a long motion."""
    sim = SimulatedDaemon(config)
    sim.run(30)
    token = acquire(sim, "anna")
    sim.core.handle(ArmRequest(lease=token, where="given", q_rad={"joint1": 0.0}), sim.now)
    sim.run(20)
    sim.settle()
    sim.core.handle(MoveRequest(lease=token, waypoints=[{"joint1": 1.5}]), sim.now)
    sim.core.handle(LeaseRequest(action="renew", lease=token), sim.now)
    return sim, token


def expired_between_two_cycles(sim: SimulatedDaemon) -> None:
    """Lets time pass until the lease is over, and the cycle that would see it has not come yet."""
    lease = sim.core.lease
    while sim.now < lease.until or sim.ticks % CYCLE == CYCLE - 1:
        sim.api_stopped = sim.now + 3 * CYCLE * sim.config.tick >= lease.until
        sim.tick()
    assert sim.core.lease is lease, "nobody has looked yet"
    sim.api_stopped = False


@pytest.mark.parametrize("wait", range(12))
def test_a_dead_clients_motion_stops_whoever_comes_next(config, wait: int) -> None:
    """The one who waits wins the time between expiry and cycle: the motion stops, and it is said why."""
    sim, _ = moving(config)
    expired_between_two_cycles(sim)
    acquire(sim, "bruno")
    sim.run(wait + 3)
    assert (sim.core.mode, sim.core.why) == (Mode.HOLDING, LEASE_LOST)
    assert [event.code for event in sim.core.events].count("lease_lost") == 1
    stopped = sim.ramp.position
    sim.run(40)
    assert sim.ramp.position == stopped


def test_a_proof_between_expiry_and_cycle_is_accepted(config) -> None:
    sim, token = moving(config)
    expired_between_two_cycles(sim)
    again = acquire(sim, "anna", lease=token)
    assert again != token
    assert (sim.core.mode, sim.core.why) == (Mode.HOLDING, LEASE_LOST)


def test_whoever_was_away_for_long_gets_no_lease_by_proof(config) -> None:
    """A computer that wakes up: its program goes on, and what it had begun hours ago must not."""
    sim, token = moving(config)
    expired_between_two_cycles(sim)
    sim.run(CYCLE + 1)
    until = sim.core.leasehold.until
    while sim.now + sim.config.tick <= until + LATE:
        sim.tick()
    late = deepcopy(sim)
    assert acquire(sim, "anna", lease=token)
    late.run(2)
    pulses = late._pulses()
    with pytest.raises(LeaseError, match="more than 10 s ago"):
        acquire(late, "anna", lease=token)
    with pytest.raises(LeaseError, match="run out"):
        late.core.handle(MoveRequest(lease=token, waypoints=[{"joint1": 1.5}]), late.now)
    late.run(30)
    assert late._pulses() == pulses


def test_every_state_and_event_is_accepted_or_refused_as_the_table_says() -> None:
    """By the operations of a lease themselves, for all pairs."""
    held = Lease().acquired("anna", 0, 10, False, None)
    leases = {LeaseState.FREE: Lease(), LeaseState.HELD: held, LeaseState.EXPIRED: held.at(10)}
    operations = {
        LeaseEvent.ACQUIRE: lambda lease: lease.acquired("x", 10, 10, False, None),
        LeaseEvent.TAKE: lambda lease: lease.acquired("x", 10, 10, True, None),
        LeaseEvent.PROVE: lambda lease: lease.acquired("anna", 10, 10, False, held.token),
        LeaseEvent.RENEW: lambda lease: lease.renewed(held.token, 5, 10),
        LeaseEvent.RELEASE: lambda lease: lease.released(held.token),
    }
    for (state, lease), (event, operation) in product(leases.items(), operations.items()):
        if (state, event) in TABLE:
            assert operation(lease).state is TABLE[state, event], (state, event)
        else:
            with pytest.raises(LeaseError):
                operation(lease)
    assert held.at(10).state is TABLE[LeaseState.HELD, LeaseEvent.TIME_OUT]


class Clients(RuleBasedStateMachine):
    """Three clients: `tokens` each ever had, `alive` those that renew. `present`: whose lease it should be."""

    @initialize()
    def begin(self) -> None:
        self.sim = SimulatedDaemon(CONFIG[0])
        self.sim.run(30)
        self.tokens: dict[str, list[str]] = {}
        self.alive: set[str] = set()
        self.moved_under = ""
        token = acquire(self.sim, "anna")
        self.sim.core.handle(ArmRequest(lease=token, where="given", q_rad={"joint1": 0.0}), self.sim.now)
        self.sim.run(20)
        self.note("anna", token)

    def note(self, client: str, token: str) -> None:
        assert all(token not in had for had in self.tokens.values()), "every lease has a new token"
        self.tokens.setdefault(client, []).append(token)
        self.alive.add(client)

    @property
    def present(self) -> str | None:
        lease = self.sim.core.lease
        return lease.token if lease is not None and self.sim.now < lease.until else None

    @rule(ticks=st.integers(1, 90))
    def wait(self, ticks: int) -> None:
        """Time passes; clients that are alive renew what they have."""
        for _ in range(ticks):
            if self.sim.ticks % 25 == 0:
                for client in self.alive:
                    self.send(LeaseRequest(action="renew", lease=self.tokens[client][-1]))
            self.sim.tick()

    @rule(client=CLIENTS, take=st.booleans())
    def acquire(self, client: str, take: bool) -> None:
        before = self.present
        try:
            token = acquire(self.sim, client, take=take)
        except LeaseError:
            assert before is not None
            assert not take
        else:
            assert before is None or take
            self.note(client, token)

    @rule(client=CLIENTS, data=st.data())
    def prove(self, client: str, data) -> None:
        """Renews with any token that it ever had."""
        proof = data.draw(st.sampled_from(self.tokens.get(client, ["forged"])))
        before, last = self.present, self.sim.core.leasehold
        try:
            token = acquire(self.sim, client, lease=proof)
        except LeaseError:
            return
        assert before is None
        assert last.token == proof, "nobody else has had it since"
        self.note(client, token)

    @rule(client=CLIENTS)
    def die(self, client: str) -> None:
        self.alive.discard(client)

    @rule(client=CLIENTS)
    def release(self, client: str) -> None:
        for token in self.tokens.get(client, [])[-1:]:
            self.send(LeaseRequest(action="release", lease=token))

    @rule(client=CLIENTS, data=st.data(), kind=st.sampled_from(["move", "jog", "disarm"]))
    def command(self, client: str, data, kind: str) -> None:
        """Commands with any token that it ever had, or a forged one: only the present one is obeyed."""
        token = data.draw(st.sampled_from([*self.tokens.get(client, []), "forged"]))
        self.sim.settle()
        before, ordered = self.present, self.sim.core.order.number
        request = {
            "move": MoveRequest(lease=token, waypoints=[{"joint1": data.draw(st.floats(-1.5, 1.5))}]),
            "jog": JogRequest(lease=token, rate_rad_per_s={"joint1": 0.2}),
            "disarm": DisarmRequest(lease=token if kind == "disarm" else "forged"),
        }[kind]
        if kind == "disarm" and self.sim.core.mode is Mode.MOVING:
            return
        accepted = self.send(request)
        if accepted:
            assert token == before
            self.moved_under = token
        elif before is not None:
            assert self.sim.core.order.number == ordered

    def send(self, request) -> bool:
        try:
            self.sim.core.handle(request, self.sim.now)
        except LrmError:
            return False
        return True

    @precondition(lambda self: hasattr(self, "sim"))
    @invariant()
    def no_motion_outlives_its_lease(self) -> None:
        """By the time of the next cycle and the ramp's next look at the order."""
        if self.sim.core.mode is Mode.MOVING and self.present is not None:
            assert self.present == self.moved_under
        if self.present is None:
            self.sim.run(CYCLE + 1)
            assert self.sim.core.mode is not Mode.MOVING
            assert not self.sim.ramp.moving


CONFIG: list = []


@pytest.mark.long
def test_clients_that_die_wait_replay_and_forge(config) -> None:
    from hypothesis.stateful import run_state_machine_as_test

    CONFIG[:] = [config]
    run_state_machine_as_test(Clients, settings=settings(stateful_step_count=30))
