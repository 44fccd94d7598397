"""Vectors in compiled code do what they say."""

import numba
import numpy as np
import pytest

from pdlab.dem import simd
from pdlab.dem.simd import (
    across,
    add_rows,
    along,
    any_below,
    choose,
    fourth,
    load,
    load_lane,
    nearest,
    quad,
    repeat,
    root,
    rows,
    size,
    spread,
    store,
    total,
)

TABLE = np.random.default_rng(1).normal(size=(16, 4))
INDEX = np.array([3, 1, 4, 15, 9, 2, 6, 5], np.uint32)


@numba.njit
def turned(table, index, lanes, back):  # type: ignore[no-untyped-def]
    x, y, z, w = across(rows(table, index, 0, 4, 0))
    store(lanes, 0, x)
    store(lanes, 8, y)
    store(lanes, 16, z)
    store(lanes, 24, w)
    store(back, 0, along(x, y, z, w))


def test_rows_go_across_into_lanes_and_back() -> None:
    lanes, back = np.zeros(32), np.zeros(32)
    turned(TABLE.reshape(-1), INDEX, lanes, back)
    assert np.array_equal(lanes.reshape(4, 8), TABLE[INDEX].T)
    assert np.array_equal(back.reshape(8, 4), TABLE[INDEX])


@numba.njit
def added(table, index, out):  # type: ignore[no-untyped-def]
    more = rows(table, index, 0, 4, 0)
    add_rows(out, index, 0, 4, 0, fourth(more) * repeat(quad(1.0, 2.0, 3.0, 4.0)))


def test_rows_are_added_one_after_the_other_even_to_the_same_place() -> None:
    out, index = np.ones(64), np.array([3, 1, 3, 3, 9, 2, 1, 5], np.uint32)
    added(TABLE.reshape(-1), index, out)
    wanted = np.ones((16, 4))
    for i in index:
        wanted[i] += TABLE[i, 3] * np.array([1.0, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(out.reshape(16, 4), wanted, rtol=1e-15)


@numba.njit
def worked_out(a, b, out):  # type: ignore[no-untyped-def]
    x, y = load_lane(a, 0), load_lane(b, 0)
    store(out, 0, choose(x, y, root(size(x)), 2.0 * x - y / 3.0))
    store(out, 8, nearest(x * 4.0))
    q = load(a, 2)
    q += spread(1.0)
    return any_below(x, y), total(q)


@pytest.mark.parametrize("shift", [0.0, -10.0])
def test_lanes_are_worked_out_one_by_one(shift: float) -> None:
    a, b, out = TABLE[:2].reshape(-1).copy(), TABLE[2:4].reshape(-1) + shift, np.zeros(16)
    below, summed = worked_out(a, b, out)
    np.testing.assert_allclose(out[:8], np.where(a < b, np.sqrt(np.abs(a)), 2.0 * a - b / 3.0), rtol=1e-14)
    assert np.array_equal(out[8:], np.rint(a * 4.0))
    assert below == bool((a < b).any())
    assert summed == pytest.approx(a[2:6].sum() + 4.0)


def test_a_lane_has_eight_numbers_and_rows_have_thirty_two() -> None:
    assert (simd.QUAD.length, simd.LANE.length, simd.ROWS.length) == (4, 8, 32)
