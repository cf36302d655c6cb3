# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the replay launch file starts."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from tactile_bringup.launch_config.graph import (
    feature_parameters_of,
    FEATURES_NODE,
    LaunchPlan,
    NodeDescription,
    PLAYER,
    recorder_node,
    sensing_graph,
    SENSING_NODES,
)
from tactile_bringup.launch_config.launch_values import LaunchValues, merge_parameters
from tactile_bringup.launch_config.model_folder import find_models
from tactile_ros.errors import TactileError


def plan_replay(values: LaunchValues) -> LaunchPlan:
    """Return the nodes that classify a recording, and the player that ends them."""
    # libraries for files, which a process that senses need not load
    from tactile_bags.bag_reader import TactileBag
    from tactile_bags.replaying.replay import recorded_config

    path = values.path('bag')
    if path is None:
        raise TactileError('name the recording to play, as bag:=FOLDER')
    try:
        rate = float(values['rate'])
    except ValueError:
        raise TactileError(f'rate is "{values["rate"]}"; it must be a number') from None
    with TactileBag(path) as bag:
        config, metadata, found = recorded_config(bag), bag.metadata, bag.namespaces
    wanted = values['namespace'].strip('/')
    if wanted and wanted not in found:
        raise TactileError(
            f'{path} holds no finger {wanted}, only {", ".join(found) or "the root"}'
        )
    namespaces = (wanted,) if wanted else found
    model = values.path('model')
    if model is None and metadata.get('models'):
        model = Path(path, metadata['models'])
        if not model.exists():
            raise TactileError(
                f'the models of this recording are not at {model.resolve()}; name them: model:=...'
            )
    models = find_models(model) if model else {}
    nodes: list[NodeDescription] = []
    for namespace in namespaces:
        recorded = {FEATURES_NODE: asdict(config)}
        parameters = merge_parameters(
            recorded, values.parameters((*SENSING_NODES, *models), namespace)
        )
        graph = sensing_graph('', models, parameters, namespace=namespace)
        nodes += [node for node in graph if node.name != 'tendon_sensor']
    if values['record']:
        nodes.append(
            recorder_node(
                Path(values['record']),
                model,
                tuple(models),
                feature_parameters_of(nodes),
                namespaces=namespaces,
                simulated=bool(metadata.get('simulated')),
                rig=False,
            )
        )
    chosen = {'namespace': wanted} if wanted else {}
    player = NodeDescription(
        'tactile_bags',
        'bag_player_node',
        PLAYER,
        {
            'bag': str(path),
            'rate': rate,
            # The processes start with it, and not all as fast.
            'subscriber_timeout_s': 60.0,
            'start_delay_s': 3.0,
            **chosen,
        },
    )
    return LaunchPlan((*nodes, player), ends_with=player.path)
