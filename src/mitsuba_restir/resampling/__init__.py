"""Resampling: reservoirs, streaming selection and MIS weights."""
