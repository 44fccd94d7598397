"""The page: views of the store, and what its users enter. No physics, no SQL."""
