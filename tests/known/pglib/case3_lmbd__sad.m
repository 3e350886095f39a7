% Tables of sad/pglib_opf_case3_lmbd__sad.m of PGLib-OPF v23.07, its comments left out.
% https://github.com/power-grid-lib/pglib-opf, CC BY 4.0.
% Copyright (c) 2011 by The Institute of Electrical and Electronics Engineers (IEEE)
function mpc = pglib_opf_case3_lmbd__sad
mpc.version = '2';
mpc.baseMVA = 100.0;
%% bus data
mpc.bus = [
1 3 110.0 40.0 0.0 0.0 1 1.00000 0.00000 240.0 1 1.10000 0.90000;
2 2 110.0 40.0 0.0 0.0 1 1.00000 0.00000 240.0 1 1.10000 0.90000;
3 2 95.0 50.0 0.0 0.0 1 1.00000 0.00000 240.0 1 1.10000 0.90000;
];
%% generator data
mpc.gen = [
1 1000.0 0.0 1000.0 -1000.0 1.0 100.0 1 2000.0 0.0;
2 1000.0 0.0 1000.0 -1000.0 1.0 100.0 1 2000.0 0.0;
3 0.0 0.0 1000.0 -1000.0 1.0 100.0 1 0.0 0.0;
];
%% generator cost data
mpc.gencost = [
2 0.0 0.0 3 0.110000 5.000000 0.000000;
2 0.0 0.0 3 0.085000 1.200000 0.000000;
2 0.0 0.0 3 0.000000 0.000000 0.000000;
];
%% branch data
mpc.branch = [
1 3 0.065 0.62 0.45 9000.0 9000.0 9000.0 0.0 0.0 1 -18.7397099664 18.7397099664;
3 2 0.025 0.75 0.7 50.0 50.0 50.0 0.0 0.0 1 -18.7397099664 18.7397099664;
1 2 0.042 0.9 0.3 9000.0 9000.0 9000.0 0.0 0.0 1 -18.7397099664 18.7397099664;
];
