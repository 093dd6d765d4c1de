import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from rmll_gaits.machine import Machine, explained, step
from rmll_gaits.table import ADVANCE, REJECT

seeds = st.integers(0, 2**32 - 1)


def reference(table, state, phi, label, frequency, age):
    """One step in plain words; the definition that the branch-free code has to meet."""
    cell = (state, label)
    phi += 1
    if table.effect[cell] == ADVANCE and phi >= table.dwell[cell] * frequency:
        return table.next_state[cell], 0, True, False
    if table.effect[cell] == REJECT and age >= table.grace[cell]:
        return table.next_state[cell], 0, False, True
    return state, phi, False, False


@given(seeds)
def test_python_numpy_and_torch_step_random_sequences_alike(random_table, seed):
    table = random_table(seed)
    rng = np.random.default_rng(seed)
    machine, twin = Machine.of(table), Machine.of(table, lambda array: torch.tensor(array))
    count = 8
    frequency = rng.integers(5, 13, count).astype(float)
    state, phi = np.full(count, table.start), np.zeros(count, int)
    for age in range(30):
        label = rng.integers(0, 16, count)
        at = step(machine, state, phi, label, frequency, age)
        inputs = (state, phi, label, frequency)
        tensors = step(twin, *map(torch.from_numpy, inputs), age)
        singly = [reference(table, *map(int, inputs), age) for inputs in zip(*inputs, strict=True)]
        for array, tensor, expected in zip(at, tensors, zip(*singly, strict=True), strict=True):
            assert array.tolist() == tensor.tolist() == list(expected)
        told = explained(machine, state, label)
        same = explained(twin, torch.from_numpy(state), torch.from_numpy(label))
        assert told.tolist() == same.tolist()
        state, phi = at.state, at.phi


@given(seeds, st.integers(0, 15), st.integers(0, 40), st.integers(0, 40))
def test_scalars_step_as_arrays_do(random_table, seed, label, phi, age):
    table = random_table(seed)
    at = step(Machine.of(table), table.start, phi, label, 9, age)
    assert tuple(at) == reference(table, table.start, phi, label, 9, age)


@given(seeds)
def test_a_label_is_explained_by_a_hold_or_an_edge_of_the_gait(random_table, seed):
    table = random_table(seed)
    states, labels = np.indices((table.num_states, 16))
    expected = table.hold | (table.effect == ADVANCE)
    assert (explained(Machine.of(table), states, labels) == expected).all()
