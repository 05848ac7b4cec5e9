"""Trains VGN on an export with its own dataset, network, loss and training script.

    python train.py EXPORT EPOCHS BATCH_SIZE

Run it with the peer's Python, and with the clone of VGN (its folder src) in PYTHONPATH: see
``../run.py``. A tenth of the grasps is for validation, as in VGN's script, and all runs on the CPU.
"""

import sys
from pathlib import Path

import numpy as np
import torch
import vgn
from vgn.networks import get_network

sys.path.append(str(Path(vgn.__file__).parents[2] / "scripts"))
import train_vgn as script

np.random.seed(0), torch.manual_seed(0)
export, epochs, batch_size = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
training, validation = script.create_train_val_loaders(
    export / "training", batch_size, 0.1, False, {}
)
print(f"{len(training.dataset)} grasps to train, {len(validation.dataset)} to validate", flush=True)
device = torch.device("cpu")
net = get_network("conv").to(device)
metrics = {
    "loss": script.Average(lambda out: out[3]),
    "accuracy": script.Accuracy(lambda out: (torch.round(out[1][0]), out[2][0])),
}
optimizer = torch.optim.Adam(net.parameters(), lr=3e-4)  # the script's default
trainer = script.create_trainer(net, optimizer, script.loss_fn, metrics, device)
evaluator = script.create_evaluator(net, script.loss_fn, metrics, device)


@trainer.on(script.Events.EPOCH_COMPLETED)
def report(engine: script.Engine) -> None:
    """Validate, and print both losses."""
    evaluator.run(validation)
    trained, tested = engine.state.metrics, evaluator.state.metrics
    print(
        f"epoch {engine.state.epoch}: training {trained['loss']:.4f},"
        f" validation {tested['loss']:.4f}, accuracy {tested['accuracy']:.2f}",
        flush=True,
    )


trainer.run(training, max_epochs=epochs)
