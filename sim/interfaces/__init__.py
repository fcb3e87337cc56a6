"""The leaf that every room may import: spatial algebra, messages, protocols, errors. Imports numpy only."""
