"""Faults in the rooms ``objects``, ``policies`` and ``sampling``."""

from __future__ import annotations

from faults.fault import Fault

FAULTS = (
    Fault(
        "inertia-axes-shifted",
        "objects/solids.py",
        "gyration_squared=(y + z, z + x, x + y)",
        "gyration_squared=(x + y, y + z, z + x)",
        ("objects/test_solids.py",),
    ),
    Fault(
        "linked-folder-followed",
        "objects/importing/folder_listing.py",
        "at = _open(stack, part, at, os.O_DIRECTORY | os.O_NOFOLLOW)",
        "at = _open(stack, part, at, os.O_DIRECTORY)",
        ("objects/test_importing.py", "objects/test_importing_urdf.py"),
    ),
    Fault(
        "mesh-not-compared-with-its-digest",
        "objects/folder_archive.py",
        "if digest(data) != sha256:",
        "if not sha256:",
        ("objects/test_folder_objects.py", "factory/test_embedded_assets.py"),
    ),
    Fault(
        "millimetres-taken-for-metres",
        "objects/importing/units.py",
        "return 0.001, ",
        "return 1.0, ",
        ("objects/test_importing.py",),
    ),
    Fault(
        "one-contact-inside-the-cone",
        "policies/contacts.py",
        "opposed = np.minimum(",
        "opposed = np.maximum(",
        ("policies/test_policies.py",),
    ),
    Fault(
        "noise-in-degrees",
        "policies/perturbed.py",
        "math.radians(settings.rotation_sigma_deg) * normal(rng, 3)",
        "settings.rotation_sigma_deg * normal(rng, 3)",
        ("policies/test_policies.py", "conformance/test_policies.py"),
    ),
    Fault(
        "pads-not-swapped-by-a-mirror",
        "policies/networks/inputs.py",
        "touch[:, ::-1] * _MIRROR_Y[:, None]",
        "touch * _MIRROR_Y[:, None]",
        ("policies/test_networks.py",),
    ),
    Fault(
        "bodies-share-a-seed-with-the-clutter",
        "sampling/spec.py",
        "rng_for(config.seed, index, Stream.BODIES)",
        "rng_for(config.seed, index, Stream.CLUTTER)",
        ("sampling/test_sampling.py", "sampling/test_variety.py"),
    ),
    Fault(
        "neighbours-of-any-split",
        "sampling/spec.py",
        "if model.split == target[1].split:",
        "if model.object_id != target[1].object_id:",
        ("sampling/test_sampling.py",),
    ),
    Fault(
        "orientations-not-uniform",
        "sampling/placement.py",
        "quat = normal(rng, 4)",
        "quat = rng.uniform(-1.0, 1.0, 4)",
        ("sampling",),
    ),
)
