"""What a flight was worth: metrics, pictures, reports. Reads run folders; never takes part in a flight."""
