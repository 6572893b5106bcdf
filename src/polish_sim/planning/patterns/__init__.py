"""The patterns a region can be covered with, and what each of them is made of."""
