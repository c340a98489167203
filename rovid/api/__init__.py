"""The Python interface: a study of logs or arrays, and its results as typed records."""
