"""URScript: from the text of a programme to threads that run at 500 Hz."""

from polish_sim.ur.script.machine import Machine
from polish_sim.ur.script.parse import ScriptError
