"""Faults in the rooms ``apps`` and ``cli``, and in what is public for PyTorch."""

from __future__ import annotations

from faults.fault import Fault

FAULTS = (
    Fault(
        "host-not-checked",
        "apps/browse/guard.py",
        "if not self._is_ours(host):",
        "if not host:",
        ("apps/test_browse_security.py",),
    ),
    Fault(
        "no-token-passes-for-the-right-one",
        "apps/browse/guard.py",
        "if not hmac.compare_digest(given.encode(), self.token.encode()):",
        "if given and not hmac.compare_digest(given.encode(), self.token.encode()):",
        ("apps/test_browse_security.py",),
    ),
    Fault(
        "files-outside-the-folder-served",
        "apps/browse/static_files.py",
        "send_from_directory(FOLDER, name, mimetype=kind)",
        "Response((FOLDER / name).read_bytes(), mimetype=kind)",
        ("apps/test_browse_security.py",),
    ),
    Fault(
        "markup-in-the-page",
        "apps/browse/static/dom.js",
        "    if (Array.isArray(child)) append(node, child);\n",
        "    if (Array.isArray(child)) append(node, child);\n"
        "    else if (typeof child === 'string') node.insertAdjacentHTML('beforeend', child);\n",
        ("apps/test_browse_grid.py", "apps/test_browse_security.py", "apps/test_browse_episode.py"),
    ),
    Fault(
        "markup-in-the-card",
        "apps/card/markdown.py",
        'inner = "".join(c if c.isalnum() and c.isascii() else _entity(c) for c in _visible(text))',
        "inner = _visible(text)",
        ("apps/test_card.py",),
    ),
    Fault(
        "ties-count-as-wins",
        "apps/learning/scores.py",
        "np.cumsum(bad, axis=1) - bad / 2.0",
        "np.cumsum(bad, axis=1)",
        ("apps/test_learning.py",),
    ),
    Fault(
        "stopping-early-on-test",
        "apps/learning/comparison.py",
        "kind, splits.train, splits.val, course.settings",
        "kind, splits.train, splits.test, course.settings",
        ("apps/test_learning.py",),
    ),
    Fault(
        "last-weights-instead-of-the-best",
        "apps/learning/training.py",
        "best, weights = epoch, copy.deepcopy(network.state_dict())",
        "best, weights = epoch, network.state_dict()",
        ("apps/test_learning.py",),
    ),
    Fault(
        "evaluation-on-training-objects",
        "apps/active_learning/settings.py",
        "self._of_base(self._seed(_Purpose.EVALUATION), HELD_OUT)",
        "self._of_base(self._seed(_Purpose.EVALUATION), LEARNING)",
        ("apps/test_active_learning.py",),
    ),
    Fault(
        "replay-always-exits-with-0",
        "cli/replay.py",
        "ctx.exit(EXIT_DONE if result.same else EXIT_FAILURE)",
        "ctx.exit(EXIT_DONE)",
        ("cli/test_cli.py", "curation/test_replay_platforms.py"),
    ),
    Fault(
        "threshold-of-zero-ignored",
        "cli/relabel.py",
        "for key, value in thresholds.items() if value is not None}",
        "for key, value in thresholds.items() if value}",
        ("curation/test_relabel.py", "cli/test_cli.py"),
    ),
    Fault(
        "fits-left-out-of-json",
        "cli/generate.py",
        'print_json(to_plain(found) | {"fits": found.fits})',
        "print_json(to_plain(found))",
        ("factory/test_dry_run.py", "cli/test_cli.py"),
    ),
    Fault(
        "workers-read-the-same-blocks",
        "torch.py",
        "np.random.default_rng(drawn).permutation(len(parts))",
        "np.random.default_rng([*drawn, share]).permutation(len(parts))",
        ("apps/test_torch_loader.py",),
    ),
)
