# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import struct

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver import LinkError
from tendon_sensor_driver.net_ft_protocol import (
    classify_status,
    Command,
    compute_rate_hz,
    compute_si_per_count,
    decode_records,
    encode_request,
    format_status,
    parse_configuration,
    unit_of_code,
)

WORDS = st.integers(0, 2**32 - 1)
COUNTS = st.lists(st.integers(-(2**31), 2**31 - 1), min_size=6, max_size=6)


def test_the_requests_are_the_known_good_bytes():
    assert encode_request(Command.START_REALTIME).hex() == '1234000200000000'
    assert encode_request(Command.STOP).hex() == '1234000000000000'


@given(st.lists(st.tuples(WORDS, WORDS, WORDS, COUNTS), min_size=1, max_size=40))
def test_records_are_read_as_struct_reads_them(rows):
    datagram = b''.join(struct.pack('>III6i', a, b, c, *counts) for a, b, c, counts in rows)
    records = decode_records(datagram)
    assert [
        (int(r['rdt_sequence']), int(r['ft_sequence']), int(r['status']), r['counts'].tolist())
        for r in records
    ] == rows


@pytest.mark.parametrize(
    ('word', 'is_axia', 'status', 'words'),
    [
        (0, False, StrainStatus.OK, ()),
        (0x80010000, False, StrainStatus.OK, ('monitor condition latched',)),
        (0x80020000, False, StrainStatus.SATURATED, ('transducer saturated or A/D error',)),
        (0x80000040, False, StrainStatus.DEVICE_ERROR, ('analog supply too high',)),
        (0x80000000, False, StrainStatus.DEVICE_ERROR, ('an unspecified error',)),
        (
            0x80020004,
            False,
            StrainStatus.SATURATED | StrainStatus.DEVICE_ERROR,
            ('transducer saturated or A/D error', 'temperature'),
        ),
        (
            0x88000000,
            False,
            StrainStatus.DEVICE_ERROR,
            ('serial link between transducer and board',),
        ),
        (0x88000000, True, StrainStatus.SATURATED, ('gauge out of range',)),
        (0xC0000000, True, StrainStatus.SATURATED, ('force or torque out of range',)),
        (0x80000004, True, StrainStatus.DEVICE_ERROR, ('broken gauge',)),
    ],
)
def test_status_words_become_bits_and_words(word, is_axia, status, words):
    bits = classify_status(np.array([0, word], dtype=np.uint32), is_axia=is_axia)
    assert bits.tolist() == [0, int(status)]
    assert format_status(word, is_axia=is_axia) == words


@given(WORDS, st.booleans())
def test_every_status_word_has_words(word, is_axia):
    assert (format_status(word, is_axia=is_axia) == ()) == (word == 0)


@pytest.mark.parametrize(
    ('asked_hz', 'made_hz'),
    [(60, 7000 / 116), (1000, 1000), (150, 7000 / 46), (4000, 7000), (7000, 7000), (9000, 7000)],
)
def test_the_rate_is_the_next_fraction_of_7000(asked_hz, made_hz):
    assert compute_rate_hz(asked_hz) == pytest.approx(made_hz, rel=1e-12)


# -- the configuration page ------------------------------------------------------------

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


def test_what_is_told_otherwise_or_not_at_all_is_read_or_marked_so():
    assert parse_configuration(page(prodname='Ethernet Axia')).is_axia
    box = parse_configuration(page(scfgfu=None, scfgtu=None, cfgfu='1', cfgtu='4'))
    np.testing.assert_allclose(box.si_per_count[[0, 3]], [4.4482216152605e-6, 2e-9])
    box = parse_configuration(page(comrdtrate=None, setuserfilter=None, comrdtbsiz=None))
    assert (box.rdt_rate_hz, box.low_pass_hz, box.records_per_datagram) == (0, -1, 0)
    assert parse_configuration(page(comrdtrate=None, commrdtrate='488')).rdt_rate_hz == 488


@pytest.mark.parametrize(
    ('changes', 'named'),
    [
        ({'cfgcpf': '0'}, 'calibration'),
        ({'cfgcpf': 'many'}, 'cfgcpf = "many"'),
        ({'cfgcpt': None}, 'cfgcpt = "None"'),
        ({'cfgcpf': 'nan'}, 'cfgcpf = "nan"'),
        ({'scfgfu': 'stone'}, '"stone"'),
        ({'scfgfu': None, 'cfgfu': '7'}, 'force unit 7'),
        ({'runstat': 'fine'}, '"fine"'),
    ],
)
def test_a_page_without_a_usable_calibration_is_refused(changes, named):
    with pytest.raises(LinkError, match=named):
        parse_configuration(page(**changes))


def test_entities_are_not_expanded():
    bomb = b'<!DOCTYPE a [<!ENTITY b "cc">]><netft><cfgcpf>&b;</cfgcpf></netft>'
    with pytest.raises(LinkError, match='XML'):
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


def test_units_have_the_codes_of_ati_and_the_newton_metres_of_their_names():
    forces = [unit_of_code('force', code) for code in range(1, 7)]
    assert forces == ['lbf', 'N', 'klbf', 'kN', 'kgf', 'gf']
    torques = [unit_of_code('torque', code) for code in (1, 3, 5)]
    assert torques == ['lbf-in', 'N-m', 'kgf-cm']
    si = [compute_si_per_count('N', unit, 1, 1)[5] for unit in ('lbf-in', 'kgf-cm', 'kNm')]
    np.testing.assert_allclose(si, [0.1129848290276167, 0.0980665, 1000.0], rtol=1e-12)
