"""Files that processes open at their start: locks, damaged and newer files, and the cache folder."""
