"""Campaigns: many trials of controllers in a cell, with variations, figures and claims."""
