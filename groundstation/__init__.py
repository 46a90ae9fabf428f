"""The ground station: what people use to run, watch, stop, record and judge a swarm."""
