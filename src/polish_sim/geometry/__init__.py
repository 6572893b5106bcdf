"""Geometry: from a part's STL to a smooth surface, the region to polish and its distance field."""

from typing import TYPE_CHECKING

from polish_sim.lazy import names_on_use

if TYPE_CHECKING:
    from polish_sim.geometry.distance_field import build_distance_field
    from polish_sim.geometry.field_lookup import field_distance
    from polish_sim.geometry.fit import fit_surface
    from polish_sim.geometry.mesh import PartMesh, load_part, part_from_arrays
    from polish_sim.geometry.regions.region import Region, merge_regions, select_region
    from polish_sim.geometry.surface import ClosestPoints, Surface
else:
    __getattr__ = names_on_use(__name__)
