"""Trains GG-CNN on an export with its own dataset, network and loop; prints the losses.

    python train.py EXPORT EPOCHS BATCHES

Run it with the peer's Python, and with the clone of GG-CNN in PYTHONPATH: see ``../run.py``. The
last tenth of the images is for validation, as in GG-CNN: their objects are others, because its
loader sorts by folder, and a folder is an object. The network is the one of the README, its
augmentation is on, and all runs on the CPU. BATCHES of 8 images are an epoch.
"""

import random
import sys

import numpy as np
import torch

np.int, np.float = int, float  # GG-CNN's names, which NumPy 1.24 removed

from models import get_network  # noqa: E402
from train_ggcnn import train, validate  # noqa: E402
from utils.data import get_dataset  # noqa: E402

random.seed(0), np.random.seed(0), torch.manual_seed(0)
export, epochs, per_epoch = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
JacquardDataset = get_dataset("jacquard")
settings = {"random_rotate": True, "random_zoom": True}
training = JacquardDataset(export, start=0.0, end=0.9, **settings)
validation = JacquardDataset(export, start=0.9, end=1.0, **settings)
batches = torch.utils.data.DataLoader(training, batch_size=8, shuffle=True)
singles = torch.utils.data.DataLoader(validation, batch_size=1, shuffle=False)
device = torch.device("cpu")
net = get_network("ggcnn")(input_channels=1).to(device)
optimizer = torch.optim.Adam(net.parameters())
print(f"{len(training)} images to train, {len(validation)} to validate", flush=True)
for epoch in range(epochs):
    trained = train(epoch, net, device, batches, optimizer, per_epoch)
    tested = validate(net, device, singles, per_epoch)
    good, all_of_them = tested["correct"], tested["correct"] + tested["failed"]
    validation_loss = tested["loss"] * len(singles) / all_of_them  # it divides by all images
    print(
        f"epoch {epoch}: training {trained['loss']:.4f}, validation {validation_loss:.4f},"
        f" overlap {good}/{all_of_them}",
        flush=True,
    )
