# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import io
import pickle
import zipfile

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_analysis.options import SourceError
from tactile_analysis.sources import arrays
from tactile_analysis.trial_set import TrialSet
from tactile_classifier.datasets.dataset import name_channel
from tactile_classifier.errors import DatasetError
from tactile_ros.errors import TactileError


def load_archive(path, **options):
    return TrialSet.load(path).even(**options)


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


def test_an_archive_is_signals_and_labels_with_their_columns(save):
    trials = load_archive(save())
    assert (len(trials), trials.rate_hz) == (12, 50.0)
    assert set(trials.trials[0].columns) == {'label', 'balanced', 'speed_mm_s'}
    x, y, groups = trials.windows('speed_mm_s')
    np.testing.assert_array_equal(x, good_arrays()['x'].astype(float))
    assert x.dtype == np.float64
    assert y.tolist() == ['denim', 'linen'] * 6
    assert groups.tolist() == [10.0, 20.0] * 6
    with pytest.raises(SourceError, match=r'"speed".* speed_mm_s'):
        trials.windows('speed')


def test_the_stated_rate_is_kept_to_the_last_digit(save, tmp_path):
    rate_hz = 100.0 / 2.808
    trials = load_archive(save(rate_hz=np.array(rate_hz)))
    assert trials.rate_hz == rate_hz
    trials.save(tmp_path / 'again.npz')
    assert load_archive(tmp_path / 'again.npz').rate_hz == rate_hz


def test_select_keeps_the_trials_and_their_columns(save):
    trials = load_archive(save())
    assert len(trials.select('balanced')) == 8
    slow = trials.select('balanced').select('speed_mm_s=10')
    assert len(slow) == 4
    assert set(slow.columns['speed_mm_s']) == {10.0}
    with pytest.raises(TactileError, match=r'"balance".* balanced'):
        trials.select('balance')
    with pytest.raises(TactileError, match='speed_mm_s=30'):
        trials.select('speed_mm_s=30')


def test_crop_takes_samples_by_time(save):
    trials = load_archive(save())  # 100 samples at 50 Hz
    whole = trials.windows()[0]
    np.testing.assert_array_equal(trials.crop(0.5, 1.5).windows()[0], whole[:, :, 25:75])
    assert trials.crop(0.0, 2.0).windows()[0].shape[2] == 100
    # The crop begins at sample 7, although 0.7 * 10 is 7.000000000000001 in floating point.
    slow = load_archive(save(rate_hz=np.array(10.0)))
    assert slow.crop(0.7, 0.9).windows()[0].shape[2] == 2
    for start_s, stop_s in ((1.0, 1.0), (1.5, 1.0), (-0.1, 1.0), (0.0, 2.1)):
        with pytest.raises(SourceError, match='2 s'):
            trials.crop(start_s, stop_s)


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
    ({'speed_mm_s': np.zeros(11)}, r'speed_mm_s .*\(11,\)'),
    ({'rate_hz': np.array(0.0)}, 'rate_hz in '),
    ({'rate_hz': np.array(np.nan)}, 'rate_hz in '),
    ({'note': np.array([None] * 12, dtype=object)}, 'array note '),
]


@pytest.mark.parametrize(('change', 'message'), BAD)
def test_bad_archive_is_refused_with_a_sentence(save, change, message):
    with pytest.raises(SourceError, match=message):
        load_archive(save(**change))


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_bad_trials_are_refused_or_skipped(save, value):
    x = good_arrays()['x'].astype(float)
    x[7, 1, 3] = value
    with pytest.raises(SourceError, match=r'1 of 12 .* trial 7: channel channel_1 .* sample 3'):
        load_archive(save(x=x))
    x[2, 0, 0] = -1e101
    trials = load_archive(save(x=x), skip_bad=True)
    two, seven = trials.skipped
    assert 'trial 2: ' in two
    assert 'overflow' in two
    assert 'trial 7: channel channel_1 is not finite at 1 of 100 samples' in seven
    assert [trial.name for trial in trials.included] == [*'01345689', '10', '11']
    np.testing.assert_array_equal(trials.windows()[0], np.delete(x, (2, 7), axis=0))
    kept = [trial.columns['balanced'] for trial in trials.included]
    np.testing.assert_array_equal(kept, np.delete(np.arange(12) < 8, (2, 7)))
    with pytest.raises(SourceError, match='12'):
        load_archive(save(x=np.full(x.shape, np.inf)), skip_bad=True)


@pytest.mark.filterwarnings('error')
def test_byte_strings_are_text_and_float32_gives_no_warning(save):
    x = good_arrays()['x'].astype(np.float32)
    x[0, 0, 0] = np.finfo(np.float32).max
    words = np.array(['drap épais', 'lin'] * 6)
    place = np.array([b'north', b'south'] * 6)
    trials = load_archive(save(x=x, label=np.char.encode(words, 'utf-8'), place=place))
    assert trials.windows()[0].max() == np.finfo(np.float32).max
    assert [trial.label for trial in trials] == words.tolist()
    assert trials.columns['place'].tolist() == ['north', 'south'] * 6


def test_trials_of_unequal_length_are_padded_or_joined_and_cut(save):
    lengths = np.arange(12) + 80
    x = good_arrays()['x'].astype(float)
    joined = np.concatenate([row[:, :n] for row, n in zip(x, lengths, strict=True)], axis=1)
    for row, count in zip(x, lengths, strict=True):
        row[:, count:] = np.nan  # padding may have any value
    padded = load_archive(save(x=x, length=lengths))
    joined = load_archive(save(x=joined, offsets=np.r_[0, np.cumsum(lengths)]))
    for trials in (padded, joined):
        assert [trial.signal.values.shape[1] for trial in trials] == lengths.tolist()
        assert set(trials.trials[0].columns) == {'label', 'balanced', 'speed_mm_s'}
        short = trials.cut_to_shortest()
        np.testing.assert_array_equal(short.windows()[0], good_arrays()['x'][:, :, :80])
        assert short.notes[-1] == 'cut to the first 1.6 s, the length of the shortest trial (0)'
    last = [trials.trials[11].signal.values[1] for trials in (padded, joined)]
    np.testing.assert_array_equal(*last)
    with pytest.raises(SourceError, match=r'5 of 12 .* trial 0: .*1\.6 s.* 1\.7 s'):
        padded.crop(0.5, 1.7)
    cut = padded.crop(0.5, 1.7, skip_bad=True)
    assert [trial.name for trial in cut.included] == [str(i) for i in range(5, 12)]
    np.testing.assert_array_equal(cut.windows()[0], good_arrays()['x'][5:, :, 25:85])


@pytest.mark.parametrize('rate_hz', [20.0, 100.0, 30.0])
def test_resampling_keeps_what_is_slow_and_drops_what_would_alias(save, rate_hz):
    t = np.arange(100) / 50.0
    slow = 3.0 + 0.5 * t + np.sin(2 * np.pi * 2.0 * t)
    x = np.broadcast_to(slow, (12, 2, 100)).copy()
    x[:, 1] = np.sin(2 * np.pi * 24.0 * t)  # aliases at 20 Hz and at 30 Hz
    trials = load_archive(save(x=x, length=np.where(np.arange(12) < 6, 100, 90))).resample(rate_hz)
    assert trials.rate_hz == rate_hz
    signals = [trial.signal for trial in trials]
    lengths = [signal.values.shape[1] for signal in signals]
    assert lengths == [2 * rate_hz] * 6 + [-(-90 * rate_hz // 50)] * 6
    for row in (0, 11):
        at_s = signals[row].time_s
        np.testing.assert_allclose(at_s, np.arange(lengths[row]) / rate_hz, rtol=1e-12)
        inner = (at_s > 0.6) & (at_s < at_s[-1] - 0.6)
        truth = 3.0 + 0.5 * at_s + np.sin(2 * np.pi * 2.0 * at_s)
        values = signals[row].values
        np.testing.assert_allclose(values[0][inner], truth[inner], atol=0.01)
        if rate_hz < 48.0:
            assert np.abs(values[1][inner]).max() < 0.01
    assert 'resampled from 50 to' in trials.notes[-1]
    assert trials.resample(rate_hz) is trials
    for other in (rate_hz * np.sqrt(2.0), 1e-9, 1e9):
        with pytest.raises(SourceError, match='two integers'):
            trials.resample(other)


def test_missing_file_folder_and_trials(save, tmp_path):
    for path in (tmp_path / 'nowhere.npz', tmp_path):
        with pytest.raises(SourceError, match=str(path)):
            load_archive(path)


def test_pickle_is_never_opened(tmp_path):
    path = tmp_path / 'evil.npz'

    class Evil:
        def __reduce__(self):
            return (open, (str(tmp_path / 'touched'), 'w'))

    path.write_bytes(pickle.dumps(Evil()))
    with pytest.raises(SourceError, match=r'evil\.npz'):
        load_archive(path)
    np.savez(path, **{**good_arrays(), 'x': np.array([Evil()], dtype=object)})
    with pytest.raises(SourceError, match='array x '):
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
    with pytest.raises(SourceError, match='1024 MiB'):
        load_archive(huge)
    path, total = save(), sum(each.nbytes for each in good_arrays().values())
    monkeypatch.setattr(arrays, 'MAX_ARCHIVE_BYTES', total)
    load_archive(path)
    monkeypatch.setattr(arrays, 'MAX_ARCHIVE_BYTES', total - 1)
    with pytest.raises(SourceError, match='MiB'):
        load_archive(path)
    with zipfile.ZipFile(path, 'a') as file:
        file.writestr('readme.txt', 'hello')
    with pytest.raises(SourceError, match=r'readme\.txt'):
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
    except SourceError:
        return
    assert all(np.isfinite(trial.signal.values).all() for trial in trials)


def test_channels_have_names(save, tmp_path):
    trials = load_archive(save(channel_names=np.array(['fx', 'fy'])))
    names = trials.trials[0].signal.channels
    assert names == ('fx', 'fy')
    assert [name_channel(each, names) for each in ('0', 1, 'fy', 'mean')] == [
        'fx', 'fy', 'fy', 'mean',
    ]  # fmt: skip
    with pytest.raises(DatasetError, match='no channel fz; the 2 channels are fx, fy'):
        name_channel('fz', names)
    trials.save(tmp_path / 'again.npz')
    assert load_archive(tmp_path / 'again.npz').trials[0].signal.channels == ('fx', 'fy')
    assert load_archive(save()).trials[0].signal.channels == ('channel_0', 'channel_1')
    for names in (['fx'], ['fx', 'fx'], ['fx', 'mean'], [1, 2]):
        with pytest.raises(SourceError, match='must be 2 different strings'):
            load_archive(save(channel_names=np.array(names)))
