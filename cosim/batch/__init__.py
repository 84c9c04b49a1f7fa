"""Many runs: sweeps, Monte Carlo, many logs and models, folders of diagnoses; on this machine or a Dask cluster.

docs/batch.md explains the command, `cosim.batch.conduct.conduct` does what it does.
"""

from cosim.calls import make_callable

make_callable(__name__)
