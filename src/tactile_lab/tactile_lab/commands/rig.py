# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile rig`: run all nodes of the rig in one process."""

from contextlib import ExitStack

from tactile_lab import options


def rig(
    models: options.ModelOption = None,
    given: options.RigOptions = options.RIG,
    namespace: options.NamespaceOption = '',
    record: options.RecordOption = None,
    watch: options.WatchOption = False,
    quiet: options.QuietOption = False,
    seed: options.SeedOption = 1,
) -> None:
    """Run all nodes of the rig in this process until Ctrl-C; print each classification.

    Starts the nodes of sensor, guide, tendon, trial runner and features, and a classifier if
    models are given. Another program starts the trials, with the action
    ``trial_runner/run_trial``. `tactile trials` runs trials without another program.
    """
    from tactile_bringup.launch_config.graph import ModelChoice, recorder_node, rig_graph
    from tactile_lab.running import open_ports, read_rig_parameters, run_nodes
    from tactile_ros.process import hold_signals

    if hold_signals().received:
        return
    parameters = read_rig_parameters(given.params, namespace)
    choice = ModelChoice.of_finger(str(models or ''), parameters)
    with ExitStack() as stack:
        ports, simulated_rig = open_ports(given, seed, stack)
        nodes = rig_graph(
            ports, choice, parameters, simulated=given.simulated, namespace=namespace
        )
        if record:
            nodes.append(recorder_node(record, namespace, classifier=choice is not None))
        run_nodes(nodes, 'rig', watch=watch, quiet=quiet, simulated_rig=simulated_rig)
