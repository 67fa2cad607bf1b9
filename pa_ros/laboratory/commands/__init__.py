"""Commands of `pa_ros` that only a clone has."""
