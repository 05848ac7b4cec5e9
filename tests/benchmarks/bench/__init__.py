"""What ``bin/bench`` runs: this factory against the article's loop, its own floor and others."""
