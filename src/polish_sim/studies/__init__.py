"""Studies: many runs of one experiment over settings and seeds (study -> rows -> table, page), and tuned
gains."""
