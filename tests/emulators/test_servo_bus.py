"""The emulated bus against packets of the public manual and the real SDK, its shafts against closed
forms.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import dynamixel_sdk as sdk
import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from stancekit.runner.worlds.dynamixel.port import ServoPackets
from tests.emulators import protocol2 as p2
from tests.emulators.servo_bus import EmulatedBus
from tests.emulators.servos import LOOP_HZ, OVERLOAD, PHYSICS_S, TRIPPED, Servos

PACKETS = {
    "ping": (p2.packet(1, p2.PING), "FF FF FD 00 01 03 00 01 19 4E"),
    "ping everyone": (p2.packet(254, p2.PING), "FF FF FD 00 FE 03 00 01 31 42"),
    "answer to a ping": (
        p2.status(1, 0, b"\x06\x04\x26"),
        "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D",
    ),
    "answer of the second": (
        p2.status(2, 0, b"\x06\x04\x26"),
        "FF FF FD 00 02 07 00 55 00 06 04 26 6F 6D",
    ),
    "read": (p2.packet(1, p2.READ, b"\x84\0\x04\0"), "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"),
    "answer to a read": (
        p2.status(1, 0, b"\xa6\0\0\0"),
        "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0",
    ),
    "write": (
        p2.packet(1, p2.WRITE, b"\x74\0\0\x02\0\0"),
        "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
    ),
    "answer to a write": (p2.status(1, 0), "FF FF FD 00 01 04 00 55 00 A1 0C"),
    "reboot": (p2.packet(1, p2.REBOOT), "FF FF FD 00 01 03 00 08 2F 4E"),
    "sync read": (
        p2.packet(254, p2.SYNC_READ, b"\x84\0\x04\0\x01\x02"),
        "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
    ),
    "second answer to it": (
        p2.status(2, 0, b"\x1f\x08\0\0"),
        "FF FF FD 00 02 08 00 55 00 1F 08 00 00 BA BE",
    ),
    "sync write": (
        p2.packet(254, p2.SYNC_WRITE, bytes.fromhex("74000400 01 96000000 02 AA000000")),
        "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    ),
    "fast sync read": (
        p2.packet(254, p2.FAST_SYNC_READ, b"\x84\0\x04\0\x03\x07\x04"),
        "FF FF FD 00 FE 0A 00 8A 84 00 04 00 03 07 04 20 F2",
    ),
    "one answer of three": (
        p2.fast_status([(3, 0, b"\xa6\0\0\0"), (7, 0, b"\x1f\x08\0\0"), (4, 0, b"\xff\x03\0\0")]),
        "FF FF FD 00 FE 19 00 55 00 03 A6 00 00 00 84 08 00 07 1F 08 00 00 16 CA 00 04 FF 03 00 00 D1 9E",
    ),
}


@pytest.mark.parametrize("name", PACKETS)
def test_packets_are_those_of_the_public_manual(name: str) -> None:
    made, written = PACKETS[name]
    assert made == bytes.fromhex(written)


@given(st.binary(max_size=200))
def test_the_crc_is_that_of_the_sdk(data: bytes) -> None:
    assert p2.crc_of(data) == p2.crc16(data) == sdk.PacketHandler(2.0).updateCRC(0, data, len(data))


@given(st.lists(st.sampled_from([0x00, 0x55, 0xFD, 0xFE, 0xFF]), max_size=40), st.integers(1, 7))
def test_what_was_stuffed_comes_out_whole_in_whatever_pieces_it_came(
    data: list[int], piece: int
) -> None:
    sent = b"\xff\xff" + p2.packet(7, p2.WRITE, bytes(data)) + p2.packet(8, p2.PING)
    reader, found = p2.Reader(), list[p2.Request]()
    for start in range(0, len(sent), piece):
        found += reader.feed(sent[start : start + piece])
    assert [(each.servo, each.instruction, each.parameters, each.sound) for each in found] == [
        (7, p2.WRITE, bytes(data), True),
        (8, p2.PING, b"", True),
    ]


@given(st.lists(st.sampled_from([0x00, 0x55, 0xFD, 0xFE, 0xFF]), min_size=1, max_size=40))
@example([0xFF, 0xFF, 0xFD, 0xFF])  # a goal of -131073 steps
@example([0xFF, 0xFF, 0xFD, 0x00, 0xFF, 0xFF, 0xFD, 0xFD])
def test_our_packets_leave_and_come_stuffed_as_servos_speak(data: list[int]) -> None:
    sent, come, packets = list[int](), io.BytesIO(p2.status(7, 0, bytes(data))), ServoPackets()
    wire = SimpleNamespace(is_using=False, clearPort=sent.clear, readPort=come.read)
    wire.setPacketTimeout = wire.isPacketTimeout = lambda *_: True
    wire.writePort = lambda packet: sent.extend(packet) or len(packet)
    assert packets.writeTxOnly(wire, 7, 116, len(data), data) == sdk.COMM_SUCCESS
    (request,) = p2.Reader().feed(bytes(sent))
    assert (request.servo, request.instruction, request.sound) == (7, p2.WRITE, True)
    assert request.parameters == (116).to_bytes(2, "little") + bytes(data)
    assert packets.readRx(wire, 7, len(data)) == (data, sdk.COMM_SUCCESS, 0)


@pytest.fixture(scope="module")
def bus() -> Iterator[EmulatedBus]:
    with EmulatedBus(range(1, 5), [0.1, -0.2, 0.3, -0.4], wire=False) as made:
        yield made


@pytest.fixture(scope="module", autouse=True)
def patience() -> Iterator[None]:
    """The SDK waits 34 ms for an answer; on a busy machine the emulator may take longer to be
    woken.
    """
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 150)
        yield


@pytest.fixture(scope="module")
def port(bus: EmulatedBus) -> Iterator[Any]:
    handler = sdk.PortHandler(bus.path)
    assert handler.setBaudRate(1000000)
    yield handler
    handler.closePort()


packets: Any = sdk.PacketHandler(2.0)


def test_the_sdk_pings_reads_and_writes(port: Any) -> None:
    assert packets.ping(port, 2) == (1120, 0, 0)
    assert packets.ping(port, 9)[1] == sdk.COMM_RX_TIMEOUT
    assert packets.write2ByteTxRx(port, 1, 38, 500) == (0, 0)
    assert packets.read2ByteTxRx(port, 1, 38) == (500, 0, 0)
    assert packets.read4ByteTxRx(port, 1, 132) == (2048 + round(0.1 * 4096 / (2 * np.pi)), 0, 0)


def test_sync_reads_fast_or_not_agree_and_indirect_data_are_what_they_point_to(port: Any) -> None:
    answers = []
    for fast in (False, True):
        group = sdk.GroupSyncRead(port, packets, 132, 4)
        assert all(group.addParam(servo) for servo in (1, 3, 4))
        assert (group.fastSyncRead() if fast else group.txRxPacket()) == 0
        answers.append([group.getData(servo, 132, 4) for servo in (1, 3, 4)])
    expected = [2048 + round(angle * 4096 / (2 * np.pi)) for angle in (0.1, 0.3, -0.4)]
    assert answers == [expected, expected]
    for place in range(4):
        assert packets.write2ByteTxRx(port, 3, 168 + 2 * place, 132 + place) == (0, 0)
    assert packets.read4ByteTxRx(port, 3, 224) == (expected[1], 0, 0)


def test_errors_are_those_of_the_protocol(port: Any) -> None:
    def error(address: int, size: int, value: int) -> int:
        return packets.writeTxRx(port, 4, address, size, list(value.to_bytes(size, "little")))[1]

    assert error(132, 4, 0) == p2.ACCESS  # read only
    assert error(116, 2, 0) == p2.DATA_LENGTH
    assert error(38, 2, 2048) == p2.DATA_RANGE
    assert error(38, 2, 400) == 0
    assert error(102, 2, 401) == p2.DATA_LIMIT
    assert error(64, 1, 1) == 0
    assert error(38, 2, 300) == p2.ACCESS  # the EEPROM is locked while the torque is on
    assert error(64, 1, 0) == 0


def alone(**registers: int) -> Servos:
    """One servo in current-based position control, its torque on, its table as given by
    r<address>.
    """
    servos = Servos([1])
    for address, value, size in ((11, 5, 1), (102, 2047, 2), (112, 32767, 4), (64, 1, 1)):
        given_value = registers.pop(f"r{address}", value)
        assert servos.write(0, address, given_value.to_bytes(size, "little")) == 0
    for name, value in registers.items():
        assert servos.write(0, int(name[1:]), value.to_bytes(1, "little")) == 0
    servos.advance(1.0)
    return servos


def test_a_small_step_is_that_of_a_critically_damped_second_order_system() -> None:
    servos = alone()
    assert servos.write(0, 116, (2048 + 60).to_bytes(4, "little")) == 0
    goal, omega = 60 * 2 * np.pi / 4096, 2 * np.pi * LOOP_HZ
    for time_s in (0.02, 0.05, 0.1, 0.2):
        servos.advance(1.0 + time_s)
        exact = goal * (1.0 - (1.0 + omega * time_s) * np.exp(-omega * time_s))
        assert servos.position[0] == pytest.approx(exact, abs=2 * omega * PHYSICS_S * goal)


def test_a_long_way_is_turned_at_the_profile_velocity_and_no_current_exceeds_its_limit() -> None:
    servos = alone(r112=40, r102=300)
    assert servos.write(0, 116, (2048 + 1000).to_bytes(4, "little")) == 0
    servos.advance(1.5)
    before, most = servos.position[0], 0.0
    for k in range(100):
        servos.advance(1.5 + 0.005 * (k + 1))
        most = max(most, abs(servos.current[0]))
    assert (servos.position[0] - before) / 0.5 == pytest.approx(
        40 * 0.229 * 2 * np.pi / 60, rel=0.01
    )
    assert 0.0 < most <= 300 * 2.69e-3


def test_a_servo_that_hears_nothing_stops_where_it_is_and_takes_no_goal_until_that_is_cleared() -> (
    None
):
    servos = alone(r98=5, r112=40)
    servos.hear(0, 1.0)
    assert servos.write(0, 116, (2048 + 1500).to_bytes(4, "little")) == 0
    servos.advance(1.09)
    assert servos.get(0, 98) == 5
    assert abs(servos.rate[0]) > 0.5
    servos.advance(1.12)
    assert servos.get(0, 98) == TRIPPED
    there = servos.position[0]
    servos.advance(3.0)
    assert servos.position[0] == pytest.approx(there, abs=0.05)
    assert abs(servos.rate[0]) < 1e-3
    assert servos.write(0, 116, (2048).to_bytes(4, "little")) == p2.DATA_RANGE
    assert servos.write(0, 98, b"\0") == 0
    assert servos.write(0, 116, (2048).to_bytes(4, "little")) == 0


def test_a_servo_driven_against_its_stop_shuts_down_until_it_is_rebooted() -> None:
    servos = Servos([1], stops_rad=(-0.5, 0.5))
    for address, value, size in ((11, 5, 1), (102, 800, 2), (64, 1, 1), (116, 4000, 4)):
        assert servos.write(0, address, value.to_bytes(size, "little")) == 0
    servos.advance(1.0)
    servos.advance(3.0)
    assert servos.position[0] == 0.5
    assert servos.get(0, 70) == OVERLOAD
    assert servos.get(0, 64) == 0
    assert servos.write(0, 64, b"\x01") == p2.ALERT | p2.ACCESS
    servos.reboot(0)
    assert servos.write(0, 64, b"\x01") == 0
