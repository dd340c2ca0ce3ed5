//! Counting leaks, false hits and disagreements of traversal engines.
