"""What other libraries do that our code relies on, or guards against: docs/library_facts.md.

A test here is red when a new version does otherwise; the row of the page says what then to look at.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no stubs)

import io
import os
from pathlib import Path

import can
import mujoco
import numpy as np
import onnxruntime
import pytest
import torch
import tyro
import yaml
import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from mujoco.batch import Batch
from rsl_rl.env import VecEnv
from safetensors.numpy import save_file

from rmll_onboard.interface.can_transport import CanTransport
from rmll_onboard.protocol.can_frame import Frame, pack
from rmll_onboard.settings.can_settings import Bus

PENDULUM = """
<mujoco>
  <option timestep="0.005"/>
  <asset><hfield name="hills" nrow="3" ncol="3" size="1 1 1 0.1"/></asset>
  <worldbody>
    <geom type="hfield" hfield="hills" pos="9 9 0"/>
    <body name="ball" pos="0 0 1"><freejoint/><geom size="0.1"/></body>
    <body pos="2 0 1">
      <joint name="swing" axis="0 1 0"/>
      <geom type="capsule" size="0.05" fromto="0 0 0 0 0 -0.3"/>
    </body>
  </worldbody>
  <sensor><jointpos name="angle" joint="swing"/></sensor>
  <actuator><motor joint="swing" nsample="4"/><motor joint="swing"/></actuator>
</mujoco>
"""


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> mujoco.MjModel:
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a log file where it stands
    return mujoco.MjModel.from_xml_string(PENDULUM)


def test_derived_fields_of_a_batch_are_one_substep_old(model: mujoco.MjModel) -> None:
    batch = Batch(model, 2)
    batch.reset()
    heights, height = batch.bind("xpos")[:, model.body("ball").id, 2], batch.bind("qpos")[:, 2]
    batch.step(nstep=1)
    assert (heights == 1.0).all() and (height < 1.0).all()
    batch.forward()
    np.testing.assert_array_equal(heights, height)


def test_sensors_are_read_before_a_state_is_integrated(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    data.qvel[model.joint("swing").dofadr] = 1.0
    mujoco.mj_step(model, data)
    assert data.sensor("angle").data == 0.0 < data.joint("swing").qpos


def test_a_derived_field_is_filled_only_once_it_is_bound(model: mujoco.MjModel) -> None:
    batch = Batch(model, 1)
    batch.reset()
    batch.bind("ctrl")[:] = 1.0
    batch.step(nstep=1)
    late = batch.bind("actuator_force")
    assert late[0, 1] == 0.0
    batch.step(nstep=1)
    assert late[0, 1] == 1.0


def test_a_control_that_is_no_number_switches_off_all_of_its_robot(model: mujoco.MjModel) -> None:
    batch = Batch(model, 2)
    batch.reset()
    force = batch.bind("actuator_force")
    batch.bind("ctrl")[:] = [[np.nan, 1.0], [2.0, 1.0]]
    batch.step(nstep=1)
    np.testing.assert_array_equal(force[:, 1], [0.0, 1.0])
    warned = batch.warning[:, int(mujoco.mjtWarning.mjWARN_BADCTRL), 1]
    np.testing.assert_array_equal(warned, [1, 0])


def test_a_robot_that_diverged_is_reset_and_no_error_is_raised(model: mujoco.MjModel) -> None:
    batch = Batch(model, 2)
    batch.reset()
    batch.bind("qvel")[1, 0] = np.nan
    batch.step(nstep=2)
    assert np.isfinite(batch.bind("qpos")).all()
    warned = batch.warning[:, int(mujoco.mjtWarning.mjWARN_BADQVEL), 1]
    np.testing.assert_array_equal(warned, [0, 1])


def test_a_batch_shares_one_height_field(model: mujoco.MjModel) -> None:
    with pytest.raises(ValueError, match="hfield_data"):
        Batch(model, 2).expand("hfield_data")


def test_delay_lines_begin_with_zeros(model: mujoco.MjModel) -> None:
    batch = Batch(model, 1)
    batch.bind("ctrl")[:] = 1.0
    batch.reset(stage=int(mujoco.mjtStage.mjSTAGE_NONE))
    assert (batch.bind("history")[0, -4:] == 0.0).all()


def test_the_number_of_threads_changes_no_bit_of_a_batch(model: mujoco.MjModel) -> None:
    ends = []
    for threads in (1, 2):
        batch = Batch(model, 8, nthread=threads)
        batch.reset()
        speeds = batch.bind("qvel")
        speeds[:] = np.random.default_rng(0).normal(size=speeds.shape)
        batch.step(nstep=50)
        ends.append(batch.bind("qpos").copy())
    np.testing.assert_array_equal(*ends)


def test_a_frame_that_python_can_filters_looks_like_an_empty_bus() -> None:
    filters = [{"can_id": 1, "can_mask": 0x7FF, "extended": False}]
    with (
        can.Bus(interface="virtual", channel="facts") as sender,
        can.Bus(interface="virtual", channel="facts", can_filters=filters) as bus,
    ):
        for identifier in (2, 1):
            sender.send(can.Message(arbitration_id=identifier, is_extended_id=False))
        assert bus.recv(0) is None
        heard = bus.recv(0)
        assert heard is not None and heard.arbitration_id == 1


def test_a_file_in_the_home_folder_changes_how_python_can_opens_a_bus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "can.conf").write_text("[default]\nreceive_own_messages = True\n")
    monkeypatch.setenv("HOME", str(tmp_path))
    heard = []
    for ignored in (False, True):
        with can.Bus(interface="virtual", channel="own", ignore_config=ignored) as bus:
            bus.send(can.Message(arbitration_id=1, is_extended_id=False))
            heard.append(bus.recv(0) is not None)
    assert heard == [True, False]

    link = CanTransport({"a": Bus("virtual", "own")}, [[1]])
    link.send(pack([Frame(0, 1, b"")]))
    assert link.receive() == []
    link.close()


def test_onnxruntimes_exceptions_share_no_base() -> None:
    for model in (b"no model", "/nowhere.onnx"):
        with pytest.raises(Exception) as caught:
            onnxruntime.InferenceSession(model)
        assert type(caught.value).__bases__ == (Exception,)


def test_pyyaml_ends_a_lone_scalar_with_dots_and_keeps_the_last_of_two_keys() -> None:
    assert yaml.safe_dump(1.5) == "1.5\n...\n"
    assert yaml.safe_load("{a: 1, a: 2}") == {"a": 2}


def test_mcaps_seeking_reader_gives_nothing_of_an_unfinished_file() -> None:
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=50)
    writer.start()
    channel = writer.register_channel("topic", "json", 0)
    for time in range(20):
        writer.add_message(channel, time, b"x" * 60, time)
    unfinished = stream.getvalue()
    with pytest.raises(McapError):
        list(make_reader(io.BytesIO(unfinished)).iter_messages())
    records = iter(StreamReader(io.BytesIO(unfinished)).records)
    found = []
    with pytest.raises(McapError):
        while True:
            found.append(type(next(records)).__name__)
    assert found.count("Message") == 20


def test_packed_data_may_become_much_more_than_they_are_and_reading_stops_where_asked() -> None:
    packed = zstandard.compress(b"\0" * 10_000_000)
    assert len(packed) < 1000
    reader = zstandard.ZstdDecompressor(max_window_size=2**25).stream_reader(packed)
    assert len(reader.read(11)) == 11
    with pytest.raises(RuntimeError) as caught:
        LZ4FrameDecompressor().decompress(b"no lz4 frame", max_length=10)
    assert type(caught.value) is RuntimeError


def test_a_torch_file_that_was_cut_short_raises_several_kinds_of_errors(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.pt"
    torch.save({"weight": torch.zeros(1000)}, path)
    whole = path.read_bytes()
    kinds = set()
    for size in (10, len(whole) // 2, len(whole) - 10):
        path.write_bytes(whole[:size])
        with pytest.raises((RuntimeError, OSError)) as caught:
            torch.load(path, weights_only=True)
        kinds.add(caught.type)
    assert kinds == {RuntimeError, OSError}


def test_a_file_of_safetensors_own_writer_is_for_its_owner_alone(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        save_file({"weight": np.zeros(3, np.float32)}, tmp_path / "policy.safetensors")
    finally:
        os.umask(before)
    assert (tmp_path / "policy.safetensors").stat().st_mode & 0o777 == 0o600


def test_rsl_rl_asks_an_environment_for_observations_and_steps_alone() -> None:
    assert VecEnv.__abstractmethods__ == {"get_observations", "step"}


def test_tyro_makes_a_negative_flag_beside_each_flag_unless_it_is_told_not_to() -> None:
    def command(json: bool = False) -> bool:
        return json

    assert tyro.cli(command, args=["--no-json"]) is False
    with pytest.raises(SystemExit):
        tyro.cli(command, args=["--no-json"], config=(tyro.conf.FlagCreatePairsOff,))
