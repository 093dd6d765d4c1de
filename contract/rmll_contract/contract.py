"""The contract that travels with a policy: everything a runtime needs besides the weights.

The trainer writes it into the checkpoint's header, the exporter into the bundle's metadata, and
the robot checks it: :attr:`Contract.digest` covers the contract and the graph it belongs to.
"""

import hashlib
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from rmll_common.errors import InputError
from rmll_contract import observation
from rmll_contract.observation import Field, Profile
from rmll_gaits.table import MachineTable
from rmll_robots import Robot

FORMAT = 1
KEY = "rmll"
"""Metadata key of the contract, in checkpoints and bundles"""


class Labels(msgspec.Struct, frozen=True):
    """Thresholds of the labelling function in the trainer."""

    contact_force: float
    """[N] a foot is touching above it, now or one policy step ago"""
    clearance: float
    """[m] a foot is clear of the ground from this height of its underside on"""


class Trace(msgspec.Struct, frozen=True):
    """Golden trace: consecutive policy steps recorded in the trainer, with what it answered.

    Inputs, one row a policy step. ``touching`` and ``clear`` are the signals of the labelling
    function; ``frequency`` is c_f. The first row starts an episode, all feet down.
    """

    touching: list[list[bool]]
    clear: list[list[bool]]
    joint_position: list[list[float]]
    joint_velocity: list[list[float]]
    projected_gravity: list[list[float]]
    angular_velocity: list[list[float]]
    command: list[list[float]]
    """vx [m/s], wz [rad/s], c_f [policy steps]"""
    # the trainer's answers
    label: list[int]
    state: list[int]
    phi: list[int]
    observation: list[list[float]]
    estimate: list[list[float]]
    action: list[list[float]]
    """As the network gave it, before it is clipped to the range of actions"""
    target: list[list[float]]
    """Joint targets [rad], before any safety limit"""


class Contract(msgspec.Struct, frozen=True):
    """Plain data, JSON at full precision. Joint lists follow ``joint_names``."""

    format: int
    gait: str
    table: dict[str, object]
    """As :meth:`rmll_gaits.table.MachineTable.to_dict` has it, unchecked"""
    robot: str
    profile: Profile
    observation: tuple[Field, ...]
    estimates: tuple[Field, ...]
    joint_names: tuple[str, ...]
    default_pose: tuple[float, ...]
    kp: float
    kd: float
    action_scale: float
    action_clip: float
    torque_limit: float
    policy_hz: int
    control_hz: int
    labels: Labels
    provenance: dict[str, Any]
    """How the policy came to be: commit, seed, steps, minutes, settings, metrics"""
    trace: Trace
    graph_sha256: str = ""
    """Of the serialised ONNX graph; empty in a checkpoint"""
    digest: str = ""
    """Of all the above; empty until :func:`seal`"""


def describe(
    robot: Robot,
    table: MachineTable,
    profile: Profile,
    labels: Labels,
    provenance: Mapping[str, object],
    trace: Trace,
) -> Contract:
    """The contract, not sealed yet, of a policy for ``table``'s gait on ``robot``."""
    return Contract(
        format=FORMAT,
        gait=table.gait,
        table=dict(table.to_dict()),
        robot=robot.name,
        profile=profile,
        observation=observation.layout(profile, table.num_states),
        estimates=observation.ESTIMATES,
        joint_names=robot.joint_names,
        default_pose=tuple(map(float, robot.default_pose)),
        kp=robot.kp,
        kd=robot.kd,
        action_scale=robot.action_scale,
        action_clip=robot.action_clip,
        torque_limit=robot.torque_limit,
        policy_hz=robot.policy_hz,
        control_hz=robot.control_hz,
        labels=labels,
        provenance=dict(provenance),
        trace=trace,
    )


def seal(contract: Contract) -> Contract:
    """The contract with its digest filled in."""
    return msgspec.structs.replace(contract, digest=_digest(contract))


def encode(contract: Contract) -> str:
    """JSON; floats keep their full precision."""
    return msgspec.json.encode(contract).decode()


def decode(text: str | bytes, source: str) -> Contract:
    """Read and check a contract; ``source`` names the file in errors.

    Raises InputError for another format version, a missing or wrongly typed entry, or a digest
    that does not match.
    """
    try:
        version = msgspec.json.decode(text, type=_Version).format
        if version != FORMAT:
            raise InputError(f"{source}: format version {version}, this rmll reads {FORMAT}")
        contract = msgspec.json.decode(text, type=Contract)
    except msgspec.DecodeError as error:
        raise InputError(f"{source}: the {KEY!r} contract cannot be read: {error}") from error
    if contract.digest != _digest(contract):
        raise InputError(f"{source}: the contract was edited, its digest does not match")
    return contract


def float_lists(array: Any) -> list[list[float]]:
    """Rows of a float array as Python floats, for a :class:`Trace`."""
    return np.asarray(array, dtype=np.float64).tolist()


class _Version(msgspec.Struct):
    format: int


def _digest(contract: Contract) -> str:
    bare = msgspec.structs.replace(contract, digest="")
    return hashlib.sha256(msgspec.json.encode(bare, order="sorted")).hexdigest()
