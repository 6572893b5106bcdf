"""Calibration: what a wrist sensor carries, from poses and readings; arrays in, no cell."""

from typing import TYPE_CHECKING

from polish_sim.lazy import names_on_use

if TYPE_CHECKING:
    from polish_sim.calibration.payload import (
        GRAVITY,
        PayloadReadings,
        fit_payload,
        fit_without_outliers,
        payload_regressor,
        plan_payload_poses,
    )
    from polish_sim.calibration.tables import (
        read_calibrated_tool,
        read_readings,
        read_table,
        residual_table,
        write_calibration,
    )
else:
    __getattr__ = names_on_use(__name__)
