"""REST, WebSocket and the console's files: the web process.

Another cell's interface at this host: `forwarding` takes /cells/NAME/…, `forward_http`, `forward_live` and `forward_stop` pass on what
is asked, over the connections of `forward_lanes`, to hosts that `neighbours` knows from the fleet. At the far host `vouched` reads the
sender's word for whom a request comes from (`cellctl.domain.forwarded`), and `page_hosts` tells the STOP listener whose pages may read
its answers.
"""
