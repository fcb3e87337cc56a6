"""The one step loop, and the recording that it fills."""
