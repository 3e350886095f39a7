"""A small valid case file that tests spoil."""

VALID = """\
name = "four"
description = "four buses in a row and a tie line"
outages = ["1-2@00:15-00:45"]

[network]
v_min_pu = 0.95

[[network.bus]]
name = "1"
vn_kv = 12.66
[[network.bus]]
name = "2"
vn_kv = 12.66
[[network.bus]]
name = "3"
vn_kv = 12.66
v_max_pu = 1.05
[[network.bus]]
name = "4"
vn_kv = 12.66

[[network.line]]
from = "1"
to = "2"
r_ohm = 0.4
x_ohm = 0.2
[[network.line]]
from = "2"
to = "3"
r_ohm = 0.5
x_ohm = 0.3
rating_mva = 5.0
[[network.line]]
from = "3"
to = "4"
r_ohm = 0.6
x_ohm = 0.4
[[network.line]]
from = "4"
to = "1"
r_ohm = 1.0
x_ohm = 1.0
in_service = false

[[line]]
name = "1-2"
breakpoint = true
[[line]]
name = "4-1"
switchable = true

[time]
start = 2016-07-12T00:00:00
slots = 4
step_min = 15

[profiles.columns]
homes = [0.4, 0.5, 0.6, 1.0]
sun = [0.0, 0.1, 0.2, 0.3]
price = [1, 1, 2, -1]

[defaults.load]
shed_cost_per_mwh = 1000.0
profile = "homes"

[[load]]
name = "village"
bus = "2"
p_max_mw = 0.8
[[load]]
name = "clinic"
bus = "4"
p_max_mw = 0.2
priority = 10.0

[[pv]]
name = "roof"
bus = "3"
p_max_mw = 0.5
profile = "sun"

[[ess]]
name = "battery"
bus = "3"
p_max_mw = 0.5
e_mwh = 2.0
soc_min = 0.1
soc_max = 0.9

[[generator]]
name = "diesel"
bus = "4"
p_min_mw = 0.1
p_max_mw = 0.4
cost_curve = [[0.0, 10.0], [0.2, 60.0], [0.4, 140.0]]
ramp_up_mw_per_h = 1.0

[[grid]]
bus = "1"
import_max_mw = 2.0
import_cost_per_mwh = 50.0
price_profile = "price"
"""
