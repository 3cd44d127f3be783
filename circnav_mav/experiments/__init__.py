"""Many flights: the benchmark, campaigns, the paper's examples."""
