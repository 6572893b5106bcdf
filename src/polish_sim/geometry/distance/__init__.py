"""Signed distance to a surface, sampled in bricks that compiled loops look up."""
