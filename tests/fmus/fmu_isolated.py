"""Runs the scripts of unpacked FMUs with nothing but the standard library; prints the name of each that made a step."""

import importlib
import pathlib
import sys


class OnlyStandardLibrary:
    """Refuses every module that is neither of the standard library nor in the FMU's own resources."""

    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top in sys.stdlib_module_names or top == "pythonfmu" or top == self.own:
            return
        raise ImportError(f"{name} is not of the standard library")


guard = OnlyStandardLibrary()
sys.meta_path.insert(0, guard)
for folder in map(pathlib.Path, sys.argv[1:]):
    resources = folder / "resources"
    guard.own = (resources / "slavemodule.txt").read_text().strip()
    sys.path.insert(0, str(resources))
    module = importlib.import_module(guard.own)
    name = guard.own.rpartition("_")[0]
    slave = getattr(module, name)(instance_name="isolated", resources=str(resources))
    slave.setup_experiment(0.0, None, None)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    assert slave.do_step(0.0, 1e-3) is True, slave.log_queue
    assert not slave.log_queue
    print(name)
