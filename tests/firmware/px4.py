"""PX4 SIH."""


def missing() -> str:
    return "not written yet"
