# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import io
import pickle
import zipfile

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_classifier.datasets import archive
from tactile_classifier.datasets.archive import load_archive, save_archive
from tactile_classifier.errors import DatasetError


def good_arrays(trials=12, samples=100):
    rng = np.random.default_rng(0)
    return {
        'x': rng.integers(0, 1000, (trials, 2, samples)).astype(np.uint16),
        'label': np.array(['denim', 'linen'] * (trials // 2)),
        'rate_hz': np.array(50.0),
        'balanced': np.arange(trials) < 8,
        'speed_mm_s': np.tile([10.0, 20.0], trials // 2),
    }


@pytest.fixture
def save(tmp_path):
    def save(remove=(), **changes):
        arrays = {**good_arrays(), **changes}
        path = tmp_path / 'trials.npz'
        np.savez(path, **{k: v for k, v in arrays.items() if k not in remove})
        return path

    return save


def test_signal_is_one_channel_or_the_mean_of_all(save):
    trials = load_archive(save(), folds=12)
    assert (len(trials), trials.rate_hz) == (12, 50.0)
    assert set(trials.columns) == {'balanced', 'speed_mm_s'}
    x = good_arrays()['x'].astype(float)
    np.testing.assert_array_equal(trials.signal(1), x[:, 1])
    np.testing.assert_array_equal(trials.signal('mean'), x.mean(axis=1))
    np.testing.assert_array_equal(trials.signal(), x[:, 0])
    assert trials.signal(0).dtype == np.float64
    with pytest.raises(DatasetError, match=r'channel 2.* channel_0, channel_1'):
        trials.signal(2)


def test_where_keeps_the_trials_and_their_columns(save):
    trials = load_archive(save())
    assert len(trials.where('balanced')) == 8
    slow = trials.where('balanced').where('speed_mm_s', 10.0)
    assert len(slow) == 4
    assert set(slow.columns['speed_mm_s']) == {10.0}
    with pytest.raises(DatasetError, match=r'"balance".* balanced'):
        trials.where('balance')
    with pytest.raises(DatasetError, match='speed_mm_s = 30'):
        trials.where('speed_mm_s', 30.0)


def test_between_takes_samples_by_time(save):
    trials = load_archive(save())  # 100 samples at 50 Hz
    cut = trials.between(0.5, 1.5)
    np.testing.assert_array_equal(cut.x, trials.x[:, :, 25:75])
    assert trials.between(0.0, 2.0).x.shape[2] == 100
    # 0.7 * 10 is 7.000000000000001 in floating point.
    assert load_archive(save(rate_hz=np.array(10.0))).between(0.7, 0.9).x.shape[2] == 2
    for start_s, stop_s in ((1.0, 1.0), (1.5, 1.0), (-0.1, 1.0), (0.0, 2.1)):
        with pytest.raises(DatasetError, match='2 s'):
            trials.between(start_s, stop_s)


BAD = [
    ({'remove': ('label', 'rate_hz')}, 'has no label and no rate_hz'),
    ({'remove': ('rate_hz',)}, r'no rate_hz; .*--rate-hz\n(.*\n)+.*offsets'),
    ({'x': np.zeros(12)}, r'\(12,\)'),
    ({'x': np.ones((12, 2, 100))}, 'constant'),
    ({'x': np.array([[1], [2, 3]] * 6, dtype=object)}, r'pickled objects.*\n(.*\n)+.*offsets'),
    ({'label': np.array(['a', 'b'] * 6, dtype=object)}, r'as label\.astype\(str\)'),
    ({'label': np.array([b'a', b'\xff'] * 6)}, r"label in .* not UTF-8: b'\\xff'"),
    ({'length': np.full(12, 101)}, 'length in .* from 1 to 100'),
    ({'x': np.zeros((2, 50)), 'offsets': np.arange(12)}, 'increasing integers from 0 to 50'),
    (
        {'x': np.zeros((2, 50)), 'offsets': np.r_[np.arange(12), 11, 50]},
        'increasing integers from 0 to 50',
    ),
    ({'x': np.full((12, 2, 5), 'a')}, 'x in '),
    ({'x': np.zeros((12, 2, 0))}, 'x in '),
    ({'label': np.array(['a', 'b'])}, r'label .*\(12,\)'),
    ({'label': np.arange(12.0)}, 'label'),
    ({'label': np.full(12, 'denim')}, '"denim"'),
    ({'speed_mm_s': np.zeros(11)}, r'speed_mm_s .*\(11,\)'),
    ({'rate_hz': np.array(0.0)}, 'rate_hz in '),
    ({'rate_hz': np.array(np.nan)}, 'rate_hz in '),
    ({'note': np.array([None] * 12, dtype=object)}, 'array note '),
]


@pytest.mark.parametrize(('change', 'message'), BAD)
def test_bad_archive_is_refused_with_a_sentence(save, change, message):
    with pytest.raises(DatasetError, match=message):
        load_archive(save(**change))


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_bad_trials_are_refused_or_skipped(save, value):
    x = good_arrays()['x'].astype(float)
    x[7, 1, 3] = value
    with pytest.raises(DatasetError, match=r'1 of 12 .* row 7: .*channel 1, sample 3'):
        load_archive(save(x=x))
    x[2, 0, 0] = -1e101
    trials = load_archive(save(x=x), skip_bad=True)
    assert [each.row for each in trials.skipped] == [2, 7]
    assert 'overflow' in trials.skipped[0].reason
    assert 'channel 1, sample 3' in trials.skipped[1].reason
    assert trials.rows.tolist() == [0, 1, 3, 4, 5, 6, 8, 9, 10, 11]
    np.testing.assert_array_equal(trials.x, np.delete(x, (2, 7), axis=0))
    np.testing.assert_array_equal(trials.columns['balanced'], np.delete(np.arange(12) < 8, (2, 7)))
    with pytest.raises(DatasetError, match='12'):
        load_archive(save(x=np.full(x.shape, np.inf)), skip_bad=True)


@pytest.mark.filterwarnings('error')
def test_byte_strings_are_text_and_float32_gives_no_warning(save):
    x = good_arrays()['x'].astype(np.float32)
    x[0, 0, 0] = np.finfo(np.float32).max
    words = np.array(['drap épais', 'lin'] * 6)
    place = np.array([b'north', b'south'] * 6)
    trials = load_archive(save(x=x, label=np.char.encode(words, 'utf-8'), place=place))
    assert trials.x.dtype == np.float32
    assert trials.label.tolist() == words.tolist()
    assert trials.columns['place'].tolist() == ['north', 'south'] * 6


def test_trials_of_unequal_length_are_padded_or_joined_and_cut(save):
    lengths = np.arange(12) + 80
    x = good_arrays()['x'].astype(float)
    joined = np.concatenate([row[:, :n] for row, n in zip(x, lengths, strict=True)], axis=1)
    for row, count in zip(x, lengths, strict=True):
        row[:, count:] = np.nan  # padding may be anything
    padded = load_archive(save(x=x, length=lengths))
    joined = load_archive(save(x=joined, offsets=np.r_[0, np.cumsum(lengths)]))
    for trials in (padded, joined):
        np.testing.assert_array_equal(trials.lengths, lengths)
        assert set(trials.columns) == {'balanced', 'speed_mm_s'}
        short = trials.cut_to_shortest()
        np.testing.assert_array_equal(short.x, good_arrays()['x'][:, :, :80])
        assert short.steps == ('cut to the first 1.6 s, the length of the shortest trial (row 0)',)
    np.testing.assert_array_equal(joined.signal(1)[11], padded.signal(1)[11, :91])
    with pytest.raises(DatasetError, match=r'5 of 12 .* row 0: .*1\.6 s.* 1\.7 s'):
        padded.between(0.5, 1.7)
    cut = dataclasses.replace(padded, skip_bad=True).between(0.5, 1.7)
    assert cut.rows.tolist() == list(range(5, 12))
    np.testing.assert_array_equal(cut.x, good_arrays()['x'][5:, :, 25:85])


@pytest.mark.parametrize('rate_hz', [20.0, 100.0, 30.0])
def test_resampling_keeps_what_is_slow_and_drops_what_would_alias(save, rate_hz):
    t = np.arange(100) / 50.0
    slow = 3.0 + 0.5 * t + np.sin(2 * np.pi * 2.0 * t)
    x = np.broadcast_to(slow, (12, 2, 100)).copy()
    x[:, 1] = np.sin(2 * np.pi * 24.0 * t)  # beyond 15 Hz, half of the lowest but one
    trials = load_archive(save(x=x, length=np.where(np.arange(12) < 6, 100, 90))).resample(rate_hz)
    assert trials.rate_hz == rate_hz
    assert trials.lengths.tolist() == [2 * rate_hz] * 6 + [-(-90 * rate_hz // 50)] * 6
    for row in (0, 11):
        at_s = np.arange(trials.lengths[row]) / rate_hz
        inner = (at_s > 0.6) & (at_s < at_s[-1] - 0.6)
        truth = 3.0 + 0.5 * at_s + np.sin(2 * np.pi * 2.0 * at_s)
        count = trials.lengths[row]
        np.testing.assert_allclose(trials.x[row, 0, :count][inner], truth[inner], atol=0.01)
        if rate_hz < 48.0:
            assert np.abs(trials.x[row, 1, :count][inner]).max() < 0.01
    assert 'resampled from 50 to' in trials.steps[0]
    assert trials.resample(rate_hz) is trials
    for other in (rate_hz * np.sqrt(2.0), 1e-9, 1e9):
        with pytest.raises(DatasetError, match='two integers'):
            trials.resample(other)


def test_missing_file_folder_and_trials(save, tmp_path):
    for path in (tmp_path / 'nowhere.npz', tmp_path):
        with pytest.raises(DatasetError, match=str(path)):
            load_archive(path, 6)
    one_label = save(label=np.full(12, 'denim'))
    assert len(load_archive(one_label, folds=0)) == 12  # not for cross-validation


def test_pickle_is_never_opened(tmp_path):
    path = tmp_path / 'evil.npz'

    class Evil:
        def __reduce__(self):
            return (open, (str(tmp_path / 'touched'), 'w'))

    path.write_bytes(pickle.dumps(Evil()))
    with pytest.raises(DatasetError, match=r'evil\.npz'):
        load_archive(path)
    np.savez(path, **{**good_arrays(), 'x': np.array([Evil()], dtype=object)})
    with pytest.raises(DatasetError, match='array x '):
        load_archive(path)
    assert not (tmp_path / 'touched').exists()


def test_what_is_too_large_or_no_array_is_refused_before_anything_is_allocated(
    save, tmp_path, monkeypatch
):
    header = io.BytesIO()
    shape = {'descr': '<f8', 'fortran_order': False, 'shape': (10**9, 1, 180)}
    np.lib.format.write_array_header_1_0(header, shape)
    huge = tmp_path / 'huge.npz'
    with zipfile.ZipFile(huge, 'w') as file:
        file.writestr('x.npy', header.getvalue())
    with pytest.raises(DatasetError, match='1024 MiB'):
        load_archive(huge)
    path, total = save(), sum(array.nbytes for array in good_arrays().values())
    monkeypatch.setattr(archive, 'MAX_ARCHIVE_BYTES', total)
    load_archive(path)
    monkeypatch.setattr(archive, 'MAX_ARCHIVE_BYTES', total - 1)
    with pytest.raises(DatasetError, match='MiB'):
        load_archive(path)
    with zipfile.ZipFile(path, 'a') as file:
        file.writestr('readme.txt', 'hello')
    with pytest.raises(DatasetError, match=r'readme\.txt'):
        load_archive(path)


@pytest.fixture(scope='module')
def good_bytes():
    file = io.BytesIO()
    np.savez_compressed(file, **good_arrays())
    return file.getvalue()


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_damaged_archive_never_raises_anything_else(good_bytes, tmp_path_factory, data):
    damaged = bytearray(good_bytes)
    for at in data.draw(st.lists(st.integers(0, len(damaged) - 1), min_size=1, max_size=3)):
        damaged[at] ^= data.draw(st.integers(1, 255))
    damaged = damaged[: data.draw(st.integers(0, len(damaged)))]
    path = tmp_path_factory.getbasetemp() / 'damaged.npz'
    path.write_bytes(bytes(damaged))
    try:
        trials = load_archive(path)
    except DatasetError:
        return
    assert np.isfinite(trials.x).all()


def test_channels_have_names(save, tmp_path):
    trials = load_archive(save(channel_names=np.array(['fx', 'fy'])))
    assert trials.channels == ('fx', 'fy')
    np.testing.assert_array_equal(trials.signal('fy'), trials.signal(1))
    assert [trials.name_channel(each) for each in ('0', 1, 'fy', 'mean')] == [
        'fx', 'fy', 'fy', 'mean',
    ]  # fmt: skip
    with pytest.raises(DatasetError, match='no channel fz; the 2 channels are fx, fy'):
        trials.signal('fz')
    save_archive(tmp_path / 'again.npz', trials)
    assert load_archive(tmp_path / 'again.npz').channels == ('fx', 'fy')
    assert load_archive(save()).channels == ('channel_0', 'channel_1')
    for names in (['fx'], ['fx', 'fx'], ['fx', 'mean'], [1, 2]):
        with pytest.raises(DatasetError, match='must be 2 different strings'):
            load_archive(save(channel_names=np.array(names)))
