"""The command line."""

from __future__ import annotations

import os


def start() -> None:
    """Load and run the command line of this process; an interrupt while it loads is one line, too."""
    try:
        from polish_sim.cli.main import app
    except KeyboardInterrupt:
        os.write(2, b"error: interrupted; nothing was recorded yet.\n")
        os._exit(130)
    app()
