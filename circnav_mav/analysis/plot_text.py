"""Users' own words in pictures."""


def literal(text: str) -> str:
    """A text that matplotlib draws as it is: in names of files and missions, dollars enclose no formula."""
    return text.replace("$", r"\$")
