# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tendon_sensor_driver import LinkError
from tendon_sensor_driver.net_ft_protocol import (
    compute_si_per_count,
    parse_configuration,
    unit_of_code,
)

TAGS = {
    'prodname': 'Ethernet F/T',
    'runstat': '0x80010000',
    'runrate': '7000',
    'cfgcalsn': 'FT12345',
    'scfgfu': 'N',
    'scfgtu': 'Nm',
    'cfgcpf': '1000000',
    'cfgcpt': '500000',
    'setuserfilter': '6',
    'comrdte': 'Enabled',
    'comrdtrate': '60',
    'comrdtbsiz': '40',
}


def page(**changes):
    tags = {name: text for name, text in {**TAGS, **changes}.items() if text is not None}
    body = ''.join(f'<{name}>{text}</{name}>' for name, text in tags.items())
    return f'<?xml version="1.0"?><netft>{body}</netft>'.encode()


def test_a_page_is_read():
    box = parse_configuration(page())
    assert (box.product, box.serial) == ('Ethernet F/T', 'FT12345')
    np.testing.assert_allclose(box.si_per_count, [1e-6] * 3 + [2e-6] * 3, rtol=1e-15)
    assert (box.internal_rate_hz, box.rdt_rate_hz, box.low_pass_hz) == (7000, 60, 18)
    assert (box.records_per_datagram, box.status, box.is_rdt_enabled) == (40, 0x80010000, True)
    assert not box.is_axia


def test_an_axia_is_known_by_its_name():
    assert parse_configuration(page(prodname='Ethernet Axia')).is_axia


def test_codes_stand_in_for_missing_names_of_units():
    box = parse_configuration(page(scfgfu=None, scfgtu=None, cfgfu='1', cfgtu='4'))
    np.testing.assert_allclose(box.si_per_count[0], 4.4482216152605e-6)
    np.testing.assert_allclose(box.si_per_count[3], 2e-9)


def test_what_is_not_told_is_marked_so():
    box = parse_configuration(page(comrdtrate=None, setuserfilter=None, comrdtbsiz=None))
    assert (box.rdt_rate_hz, box.low_pass_hz, box.records_per_datagram) == (0, -1, 0)
    assert parse_configuration(page(comrdtrate=None, commrdtrate='488')).rdt_rate_hz == 488


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'cfgcpf': '0'}, 'has a calibration'),
        ({'cfgcpf': 'many'}, 'cfgcpf = "many"'),
        ({'cfgcpt': None}, 'cfgcpt = "None"'),
        ({'cfgcpf': 'nan'}, 'cfgcpf = "nan"'),
        ({'scfgfu': 'stone'}, 'its force in "stone"'),
        ({'scfgfu': None, 'cfgfu': '7'}, 'force unit 7; known are 1 to 6'),
        ({'runstat': 'fine'}, 'its status as "fine"'),
    ],
)
def test_a_page_without_a_usable_calibration_is_refused(changes, reason):
    with pytest.raises(LinkError, match=reason):
        parse_configuration(page(**changes))


def test_entities_are_not_expanded():
    bomb = b'<!DOCTYPE a [<!ENTITY b "cc">]><netft><cfgcpf>&b;</cfgcpf></netft>'
    with pytest.raises(LinkError, match='no plain XML'):
        parse_configuration(bomb)


@given(st.binary(max_size=300))
def test_any_page_is_read_or_refused(body):
    with pytest.raises(LinkError):
        parse_configuration(body)


@given(st.dictionaries(st.sampled_from(sorted(TAGS)), st.text('0123456789xXabN-.e', max_size=8)))
def test_any_text_in_a_tag_is_read_or_refused(changes):
    try:
        box = parse_configuration(page(**changes))
    except LinkError:
        return
    assert np.isfinite(box.si_per_count).all()
    assert (box.si_per_count > 0).all()
    assert 0 <= box.status < 2**32


def test_the_codes_of_units_are_those_of_ati():
    forces = [unit_of_code('force', code) for code in range(1, 7)]
    assert forces == ['lbf', 'N', 'klbf', 'kN', 'kgf', 'gf']
    assert [unit_of_code('torque', code) for code in (1, 3, 5)] == ['lbf-in', 'N-m', 'kgf-cm']


def test_torque_units_in_newton_metres():
    si = [compute_si_per_count('N', unit, 1, 1)[5] for unit in ('lbf-in', 'kgf-cm', 'kNm')]
    np.testing.assert_allclose(si, [0.1129848290276167, 0.0980665, 1000.0], rtol=1e-12)
