"""Learned feature matchers: networks with pretrained weights, run on the CPU without a network connection."""
