# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The script docs/trial_picture.py, which draws one simulated trial."""

from pathlib import Path
import runpy
import sys

import numpy as np
import pytest

from tactile_bringup.trial_protocols import TrialConfig
from tactile_lab.simulation.simulated_trials import SimulationPlan
from tactile_sim.descriptions.catalogue import Catalogue

DOCS = Path(__file__).resolve().parents[4] / 'docs'
if not DOCS.is_dir():
    pytest.skip('the packages are not in their own repository', allow_module_level=True)
_PICTURE = runpy.run_path(str(DOCS / 'trial_picture.py'))
draw_picture, simulate_picture, surface_drop_m = (
    _PICTURE[name] for name in ('draw_picture', 'simulate_picture', 'surface_drop_m')
)

CONFIG = TrialConfig()


def picture_of(protocol, contact='flexion'):
    return simulate_picture(SimulationPlan(protocol, contact, 1, 1), CONFIG, Catalogue(None))


@pytest.mark.parametrize('contact', ['flexion', 'abduction'])
def test_finger_is_free_at_rest_and_moves_along_the_plate(contact):
    picture = picture_of('texture', contact)
    finger = picture.catalogue.finger(contact)
    top_m = surface_drop_m(finger)
    gaps_m = [top_m - shape.curve_m[-1, 1] - finger.tip_radius_m for shape in picture.shapes]
    assert [shape.moment for shape in picture.shapes] == ['at rest', 'start', 'middle', 'end']
    assert gaps_m[0] > 5e-3
    # The fingertip overlaps the undeformed plate by less than 1 mm plus the depth of a groove.
    assert all(-2e-3 < gap < 0.0 for gap in gaps_m[1:])
    bases_m = [shape.curve_m[0] for shape in picture.shapes]
    start_m, length_m = CONFIG.guide_start_m, CONFIG.glide_length_m
    ways_m = np.array([0.0, 0.0, 0.5, 1.0]) * length_m
    assert np.array(bases_m) == pytest.approx(np.column_stack([start_m + ways_m, 0 * ways_m]))


@pytest.mark.parametrize(
    ('protocol', 'last'),
    [('texture', 'amplitude [mN]'), ('stiffness', 'true contact force [N]')],
)
def test_figure_is_marked_as_simulated_and_labelled(protocol, last):
    picture = picture_of(protocol)
    figure = draw_picture(picture)
    (title,) = (text.get_text() for text in figure.texts)
    assert title.startswith(f'SIMULATED {protocol} trial: flexion on {picture.label}')
    assert 'no number is a measurement' in title
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels[:3] == ['drop below the base [mm]', 'tendon tension [N]', last]
    phases = {text.get_text() for text in figure.axes[1].texts}
    assert {'contact', 'release'} < phases
    assert figure.axes[0].get_aspect() == 1.0


@pytest.fixture
def draw(monkeypatch, capsys):
    """Return a function that runs the script and returns its exit code and standard error."""

    def draw(*arguments):
        monkeypatch.setattr(sys, 'argv', ['trial_picture.py', *map(str, arguments)])
        try:
            _PICTURE['main']()
        except SystemExit as end:
            return end.code, capsys.readouterr().err
        return 0, capsys.readouterr().err

    return draw


def test_a_plate_of_your_own_becomes_a_png_file_or_a_sentence(draw, tmp_path):
    mine = tmp_path / 'mine'
    mine.mkdir()
    plate = (
        'R1: {groove: triangular, pitch_mm: 2.0, width_mm: 2.0, depth_mm: 0.4, '
        'end_mm: 10, grooved_mm: 50, friction: 0.5}\n'
    )
    (mine / 'plates.yaml').write_text(plate)
    code, said = draw(tmp_path / 'trial', '--contact', 'flexion', '--description', mine)
    assert code == 0, said
    assert (tmp_path / 'trial').read_bytes().startswith(b'\x89PNG')
    code, said = draw(tmp_path / 'none' / 'trial.png')
    assert code == 2
    assert 'cannot write' in said
    (mine / 'plates.yaml').write_text('R1: {groove: round}\n')
    code, said = draw(tmp_path / 'trial', '--description', mine)
    assert code == 2
    assert 'groove' in said
