# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Access rules of the live page."""

import json

from hypothesis import example, given
from hypothesis import strategies as st
import pytest

from tactile_lab.watch.access import Access, ACTIONS, CommandError, read_command

SIMPLE = st.none() | st.integers() | st.text(max_size=20)
ACCESS = Access(8642, 'Lab-PC', 'secret')


@given(st.text(max_size=300) | st.recursive(SIMPLE, st.lists, max_leaves=8))
def test_any_text_is_a_command_or_refused(text):
    try:
        command = read_command(text if isinstance(text, str) else json.dumps(text))
    except CommandError:
        return
    assert command.action in ACTIONS


@example('home', {'token': 'secret'})
@example('home', {'token': 'Secret'})
@given(
    st.sampled_from(ACTIONS),
    st.dictionaries(
        st.sampled_from(['do', 'finger', 'token', 'protocol', 'contact', 'object', 'more']),
        st.sampled_from([*ACTIONS, 'texture', 'flexion']) | st.text(max_size=8) | st.none(),
    ),
)
def test_any_object_is_a_command_or_refused_and_only_stop_needs_no_token(action, document):
    document = {'do': action, **document}
    try:
        command = read_command(json.dumps(document))
    except CommandError:
        return
    assert command.action == document['do']
    assert (command.trial is not None) == (command.action == 'trial')
    is_refused = command.action != 'stop' and command.token != 'secret'
    assert bool(ACCESS.refuse_command(command)) == is_refused


@pytest.mark.parametrize(
    'text',
    [
        *('', 'stop', '[]', '{}', '{"do": "shutdown"}', '{"do": "stop", "finger": "\\u0000"}'),
        *('[' * 4000, '"' + 'x' * 5000 + '"', json.dumps({'do': 'x' * 201})),
    ],
)
def test_invalid_commands_are_refused(text):
    with pytest.raises(CommandError):
        read_command(text)


@pytest.mark.parametrize(
    'host', ['127.0.0.1:8642', 'localhost:8642', '[::1]:8642', 'LAB-PC:8642', '10.0.0.7:8642']
)
def test_own_hosts_and_origins_are_served(host):
    assert ACCESS.refuse_request(host, None, is_socket=False) is None
    assert ACCESS.refuse_request(host, f'http://{host}', is_socket=True) is None


@pytest.mark.parametrize(
    'host',
    [
        *('', 'evil.example:8642', 'localhost.evil.example:8642', '127.0.0.1.evil.example:8642'),
        *('localhost:8643', '127.0.0.1', 'localhost:8642@evil.example', '[::1', 'localhost:x'),
        'evil.example/localhost:8642',
    ],
)
def test_foreign_hosts_are_refused(host):
    assert ACCESS.refuse_request(host, None, is_socket=False)
    assert ACCESS.refuse_request(host, f'http://{host}', is_socket=True)


@pytest.mark.parametrize(
    'origin',
    [None, 'null', 'http://evil.example', 'https://localhost:8642', 'http://localhost:8643', ''],
)
def test_foreign_origins_get_no_socket(origin):
    assert ACCESS.refuse_request('localhost:8642', origin, is_socket=True)


@given(st.text(max_size=60), st.none() | st.text(max_size=60))
def test_any_headers_are_accepted_or_refused(host, origin):
    if not ACCESS.refuse_request(host, origin, is_socket=True):
        assert origin == f'http://{host}'
