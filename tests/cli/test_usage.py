"""Help, versions and wrong words on the command line; options reach the scenario in SI."""

import math
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from polish_sim import __version__
from polish_sim.cli.catalogue import KINDS
from polish_sim.cli.main import COMMANDS
from polish_sim.cli.options import OWN, build_scenario, config_keys, named_options, refuse_idle_on_path, takes
from polish_sim.config import PlanConfig, Scenario
from polish_sim.config.key import Unit
