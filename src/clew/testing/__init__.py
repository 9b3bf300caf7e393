"""Laws that users can run on their own factors, and tiny graphs with exact answers."""
