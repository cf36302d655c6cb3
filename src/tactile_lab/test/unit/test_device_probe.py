# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recognition of devices from received bytes."""

import os
from pathlib import Path
import re

from hypothesis import given
from hypothesis import strategies as st
import pytest

from tactile_lab.devices.device_probe import find_holders, find_names, NAME_FOLDERS, recognise
from tendon_sensor_driver import LineDecoder, TendonSensorConfig

MILLISECONDS = {'time_column': 0, 'time_unit_s': 0.001}


def lines(*texts, end='\r\n'):
    """Return received bytes that begin and end in the middle of a line."""
    return ('3,cut' + end + end.join(texts) + end + texts[0][:3]).encode()


@pytest.mark.parametrize(
    ('data', 'what'),
    [
        (b"\r\nGrbl 1.1h ['$' for help]\r\n", 'Grbl: "Grbl 1.1h"'),
        (b"\x00\xf8\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n", 'Grbl: "GrblHAL 1.1f"'),
        (b'<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n', 'Grbl, in state Idle'),
        (b'<Hold:0|MPos:0.000,0.000,0.000>\r\n', 'Grbl, in state Hold'),
    ],
)
def test_grbl_is_recognised_by_banner_or_status(data, what):
    assert recognise(data) == ('guide', what, {})


OPEN_SCALE = lines(*(f'{16 * i},{0.5 + i / 100:.2f},lbs,24.75,' for i in range(100, 110)))
FLOAT_TIME = {'time_column': 0, 'time_unit_s': 1.0, 'time_decimals': 1, 'value_column': 1}
NO_TIME = {'time_column': -1, 'value_column': 0}
BANNER = b'\r\nSerial Load Cell Converter version 1.2\r\nMinimum time between reports: 16\r\n'


@pytest.mark.parametrize(
    ('said', 'parameters'),
    [
        (OPEN_SCALE, {**MILLISECONDS, 'value_column': 1, 'unit': 'lbf'}),
        (BANNER + OPEN_SCALE, {**MILLISECONDS, 'value_column': 1, 'unit': 'lbf'}),
        (lines(*(f'{-3.5 + i:.1f}' for i in range(8)), end='\n'), NO_TIME),
        (lines(*(f'{i / 10:.1f} {i}' for i in range(8)), end='\n'), FLOAT_TIME),
    ],
)
def test_columns_of_load_cell_lines_are_recognised(said, parameters):
    device, _, found = recognise(said)
    assert (device, found) == ('sensor', parameters)
    assert recognise(BANNER) is None


@pytest.mark.parametrize(
    ('texts', 'parameters'),
    [
        (['ST,GS,+  12.34 kg', 'US,GS,+  12.35 kg'], {'value_column': 2, 'unit': 'kg'}),
        (['S S      12.34 g', 'S D     -12.35 g'], {'value_column': 2, 'unit': 'g'}),
        (['-   12.34 mN', '+   12.34 mN'], {'value_column': 0, 'unit': 'mN'}),
        (['12.34oz', '12.35oz'], {'value_column': 0, 'unit': 'oz'}),
    ],
)
def test_columns_and_unit_of_scale_indicators_are_recognised(texts, parameters):
    device, what, found = recognise(lines(*texts * 4))
    assert (device, found) == ('sensor', {'time_column': -1, **parameters})
    assert what == f'load-cell lines such as "{texts[1]}"'
    decoder = LineDecoder(TendonSensorConfig(**found))
    assert len(decoder.feed(lines(*texts * 4), 0)) >= 7


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('12,34', 'decimal mark'),
        ('1 234.5 kg', 'thousands'),
        ('12.34 units', 'the word "units"'),
        ('OL,GS,+  12.34 kg', 'overload'),
    ],
)
def test_lines_that_the_driver_rejects_are_reported(text, reason):
    device, what, parameters = recognise(lines(*[text] * 8))
    assert (device, parameters) == ('sensor', {})
    assert f'"{text}", which are refused: ' in what
    assert reason in what


def test_open_scale_in_its_menu_is_recognised():
    device, what, _ = recognise(
        b'System Configuration\r\n1) Tare scale to zero [0]\r\nx) Exit\r\n>'
    )
    assert device == 'sensor'
    assert 'menu' in what


@pytest.mark.parametrize(
    'data', [b'', b'\n\n\n\n\n\n', b'hello\nworld\nhow\nare\nyou\ntoday\n', b'1\n2\n', b'1,2,3']
)
def test_unknown_data_are_not_recognised(data):
    assert recognise(data) is None


@given(st.binary(max_size=300))
def test_recognition_accepts_any_bytes(data):
    answer = recognise(data)
    assert answer is None or answer[0] in ('guide', 'sensor')


def test_names_and_programs_of_a_port_are_found(tmp_path):
    master, slave = os.openpty()
    try:
        port = os.ttyname(slave)
        folder = tmp_path / 'by-id'
        folder.mkdir()
        (folder / 'usb-maker_thing').symlink_to(port)
        (folder / 'usb-other').symlink_to('/dev/null')
        assert find_names(port, [str(folder), str(tmp_path / 'none')]) == (
            str(folder / 'usb-maker_thing'),
        )
        assert any(holder.endswith(f'({os.getpid()})') for holder in find_holders(port))
    finally:
        os.close(slave)
        os.close(master)
    assert not any(holder.endswith(f'({os.getpid()})') for holder in find_holders(port))


def test_udev_rules_name_the_ports_and_are_installed():
    package = Path(__file__).parents[3] / 'tactile_bringup'
    rules = (package / 'udev' / '60-tactile.rules').read_text()
    lines = [line for line in rules.splitlines() if line and not line.startswith('#')]
    # udev ignores a line with a misspelt key, and "=" assigns a value where "==" compares.
    part = re.compile(
        r'(ACTION|SUBSYSTEM|DRIVERS|SYMLINK|ATTRS\{\w+\})(==|!=)"[^"]+"'
        r'|(SYMLINK\+|GROUP|MODE|GOTO|LABEL|ENV\{\w+\}|ATTR\{[\w/]+\})="[^"]+"'
    )
    for line in lines:
        assert all(part.fullmatch(text) for text in line.split(', ')), line
    for name in ('guide', 'tendon', 'sensor'):
        assert f'SYMLINK+="{NAME_FOLDERS[0].removeprefix("/dev/")}/{name}"' in rules
    assert "glob('udev/*.rules')" in (package / 'setup.py').read_text()
