"""Analysis of a result: measure, compare, diagnose, predict."""
