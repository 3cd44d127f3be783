"""Mission files: TOML in, one frozen and validated `Mission` out, and the lines of `check` about
it."""
