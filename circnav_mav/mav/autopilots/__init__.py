"""Vehicle adapters: one file per vehicle, a common interface (`interface`), and a row in
`table`."""
