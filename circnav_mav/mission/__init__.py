"""Mission files: TOML in, one frozen and validated `Mission` out. Also the checks of a mission
before the flight."""
