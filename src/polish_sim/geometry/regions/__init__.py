"""Which part of the surface is polished: choices, outlines, margins, patches."""
