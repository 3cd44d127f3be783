"""Mission files: TOML in, one frozen and validated `Mission` out, and what `check` says of it."""
