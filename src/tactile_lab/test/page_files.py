# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Small SIMULATED recordings and models on which the commands of how-to pages are tested.

The pages use files of the reader, or recordings that take minutes to make. In the test, small
files have their names. The commands of a page run in order, in a separate folder.
"""

from dataclasses import dataclass
from pathlib import Path
import re
import shutil

import numpy as np

from tactile_ros.topics import EVENT


@dataclass(frozen=True)
class Recordings:
    """Bags and a model file that are made once per test session.

    Attributes
    ----------
    texture : Path
        Bag of two plates, with 4 trials on each in two sessions.
    old, new : Path
        Bags with one trial on each plate in each of two sessions. ``new`` has other trials.
    holds : dict of str to Path
        A bag of stiffness trials for each object.
    grooves : Path
        Bag of the plates of the experiment.
    model : Path
        Model file trained on ``old``.
    """

    texture: Path
    old: Path
    new: Path
    holds: dict[str, Path]
    grooves: Path
    model: Path


def keep(chosen, speeds=None):
    """Return a function for ``rewrite`` that keeps the trials whose id matches ``chosen``.

    If ``speeds`` [m/s] is given, the sliding speeds of the trials are replaced by its values in
    turn.
    """
    speed_of = {}

    def change(type_name, message):
        if type_name != EVENT:
            return message
        if not re.search(chosen, message.trial_id):
            return None
        if speeds:
            turn = speeds[len(speed_of) % len(speeds)]
            message.glide_speed_m_s = speed_of.setdefault(message.trial_id, turn)
        return message

    return change


def make_fabrics(folder, recordings):
    """Write a NumPy archive that has the arrays and columns of the real fabric_slide.npz."""
    speed, force, label, _ = np.array(
        np.meshgrid([10.0, 20.0, 50.0, 100.0], [1.0, 2.0, 3.0], [0, 1], [0, 1])
    ).reshape(4, -1)
    rng = np.random.default_rng(0)
    at_mm = np.outer(speed, np.arange(180) / 35.61)
    x = np.sin(2 * np.pi * at_mm / (6 + 4 * label)[:, np.newaxis])
    x = x[:, np.newaxis] + rng.normal(0.0, 0.1, (len(label), 2, 180))
    columns = {'speed_mm_s': speed, 'force_set': force, 'balanced': np.ones(len(label), bool)}
    names = np.where(label == 0, 'felt', 'wool')
    np.savez(folder / 'fabric_slide.npz', x=x, label=names, rate_hz=35.61, **columns)


def make_holds(folder, recordings):
    """Write an archive like phac_hold.npz: 6 repetitions of 2 labels, 10 s at 100 Hz."""
    rng = np.random.default_rng(0)
    label, repetition = np.repeat([0, 1], 6), np.tile(np.arange(6), 2)
    time_s = np.arange(1000) / 100.0
    x = 5.0 + label[:, np.newaxis] + np.exp(-time_s) + rng.normal(0.0, 0.01, (12, 1000))
    names = np.where(label == 0, 'foam', 'wood')
    path = folder / 'phac_hold.npz'
    np.savez(path, x=x, label=names, rate_hz=100.0, repetition=repetition)


def make_archive(name, channels=('fx', 'fy', 'fz')):
    """Return a function that writes an archive: 12 trials of each of 2 labels, 3 s at 60 Hz."""

    def make(folder, recordings):
        rng = np.random.default_rng(1)
        waves = [_glide(hz, rng) for hz in (4.0, 9.0) for _ in range(12)]
        x = np.array(waves)[:, np.newaxis] + rng.normal(0.0, 0.01, (24, len(channels), 180))
        label, session = np.repeat(['coarse', 'fine'], 12), np.tile([0, 1, 2], 8)
        np.savez(
            folder / name, x=x, label=label, rate_hz=60.0, unit='N', session=session,
            channel_names=channels,
        )  # fmt: skip

    return make


def _glide(pitch_hz, rng):
    return 3.0 + 0.05 * np.sin(2 * np.pi * (pitch_hz * np.arange(180) / 60 + rng.random()))


def make_lab(folder, recordings):
    """Write 24 CSV files with a German number format: 8 trials for each of 3 labels."""
    rng = np.random.default_rng(2)
    head = 'Versuch 1\nDMS 3\n\nZeit [ms];Kraft [N];Temperatur [°C]\n'
    for number in range(24):
        path = folder / 'lab' / ('pla', 'rubber', 'steel')[number % 3] / f'{number // 3}.csv'
        path.parent.mkdir(parents=True, exist_ok=True)
        rows = [
            f'{10 * i};{3 + rng.normal(0.0, 0.1):.4f};{21 + i / 1000:.3f}'.replace('.', ',')
            for i in range(293 + number % 8)
        ]
        path.write_text(head + '\n'.join(rows) + '\n', encoding='utf-8')


def make_trial(folder, recordings):
    """Write a CSV file whose column of times does not state its unit."""
    rows = [f'{10 * i},{1.5 + i % 3}' for i in range(300)]
    (folder / 'trial.csv').write_text('time,force_n\n' + '\n'.join(rows) + '\n')


def make_new(folder, recordings):
    """Write a CSV file with two trials: one on a trained object, and one on an unknown object."""
    rng = np.random.default_rng(3)
    rows = [
        f'{trial},{i / 60:.6f},{force}'
        for trial, hz in enumerate((4.0, 20.0))
        for i, force in enumerate(_glide(hz, rng) + rng.normal(0.0, 0.01, 180))
    ]
    (folder / 'new.csv').write_text('trial,time_s,force_n\n' + '\n'.join(rows) + '\n')


def place(*names):
    """Return a function that copies test recordings to the paths that a page uses.

    Each of ``names`` is an attribute of `Recordings` or an object label, ``=``, and a path.
    """

    def copy(folder, recordings):
        for name in names:
            kind, path = name.split('=')
            source = (
                recordings.holds[kind] if kind in recordings.holds else getattr(recordings, kind)
            )
            target = folder / path
            target.parent.mkdir(parents=True, exist_ok=True)
            (shutil.copytree if source.is_dir() else shutil.copyfile)(source, target)

    return copy


TEXTURE = 'texture=bags/texture_flexion'

FILES = {
    ('evaluation.md', r'tactile evaluate bags/\* --report'): place(TEXTURE),
    ('evaluation.md', 'tactile evaluate trials.npz'): make_archive('trials.npz', ['fx']),
    ('evaluation.md', r'tactile evaluate new/\*'): place(
        'new=new/texture_flexion', 'model=models/texture_flexion.npz'
    ),
    ('evaluation.md', 'tactile train old'): place('old=old/texture_flexion'),
    ('on_your_hand.md', 'tactile train own/'): place('sponge=own/sponge', 'pla=own/pla'),
    ('real_recordings.md', 'tactile evaluate fabric'): make_fabrics,
    ('real_recordings.md', 'tactile evaluate phac'): make_holds,
    ('real_recordings.md', 'tactile train bags'): place(
        TEXTURE, 'sponge=bags/sponge', 'pla=bags/pla'
    ),
    ('speed.md', 'tactile evaluate bags'): place(TEXTURE),
    ('speed.md', 'tactile evaluate fabric'): make_fabrics,
    ('your_data.md', 'tactile evaluate bags'): place(TEXTURE),
    ('your_data.md', 'tactile import lab'): make_lab,
    ('your_data.md', 'tactile import trial'): make_trial,
    ('your_data.md', 'tactile train lab'): make_archive('lab.npz'),
    ('your_data.md', 'tactile classify new'): make_new,
    ('your_data.md', 'tactile show models'): place('model=models/texture_flexion.npz'),
}
"""Functions that make files. Each one runs once, before the first command on a page that matches
its pattern."""


def make_files(page, command, folder, recordings, done):
    """Make the files that a command needs, unless they were made for an earlier command."""
    for key, make in FILES.items():
        if key[0] == page.name and key not in done and re.match(key[1], command.text):
            done.add(key)
            make(folder, recordings)
