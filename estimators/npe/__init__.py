"""Neural posterior estimation, with zuko's flows or sbi's.

`config.py` the TOML of a training; `bank.py` the simulations; `coordinates.py`, `features.py`, `networks.py`,
`published.py` what the network sees and is; `loop.py`, `adamw.py`, `checkpoint.py` the optimisation;
`training.py` all of it together; `flows.py`, `estimator.py` the trained flow; `storage.py` the model folder.
"""

from gaugeblock.core.errors import require

for _module in ("torch", "zuko", "safetensors"):
    require(_module, "sbi")

from gaugeblock.estimators.npe.config import TrainingConfig, read_config  # noqa: E402
from gaugeblock.estimators.npe.estimator import NPE  # noqa: E402
from gaugeblock.estimators.npe.shipped import reference_model_path  # noqa: E402
from gaugeblock.estimators.npe.storage import load  # noqa: E402
from gaugeblock.estimators.npe.training import run_training, train  # noqa: E402

__all__ = ["NPE", "TrainingConfig", "load", "read_config", "reference_model_path", "run_training", "train"]
