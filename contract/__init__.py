"""The nouns every room of the field kit shares: messages, keys, the arena file, check results.

This package holds no algorithm, opens nothing and logs nothing, and imports no other room.
"""
