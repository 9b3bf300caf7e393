"""Have we been here before? Candidates, descriptors, verification, consistency."""
