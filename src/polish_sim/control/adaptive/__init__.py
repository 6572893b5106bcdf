"""Controller ``hybrid-adaptive``: named laws, each a small file, composed in ``law``."""
