"""Link to a KUKA controller (KRC) by its Robot Sensor Interface; docs/rsi.md describes it.

Files by concern:

- ``kind``, ``config``: the kind of link ``rsi`` and its configuration;
- ``setup``, ``axes``, ``ethernet_file``, ``ethernet_vocabulary``, ``ethernet_checks``: from the cell's
  configuration and the KRC's own file to a link;
- ``telegram``, ``xml``, ``udp``: telegrams, replies and the socket;
- ``ipoc_and_delay``: the KRC's IPOC and Delay, missed telegrams and late replies;
- ``link``, ``states``, ``program_run``, ``setpoint``: the link, from telegrams to replies and ticks;
- ``supervision``, ``synchronisation``, ``probe``, ``wrong_mode_detection``, ``diagnostics``: checks of each
  telegram;
- ``udp_link``: the link on its socket;
- ``commissioning``: ``armgate rsi``.
"""
