"""Messages that can carry a range (`table`), and their conversion to range samples (`reader`)."""
