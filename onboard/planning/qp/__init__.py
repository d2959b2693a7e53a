"""Eq. 17 as quadratic programs: splines, one axis, climbs, the search over crossing times."""
