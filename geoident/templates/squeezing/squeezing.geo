// A circular tunnel of radius 4 m in weak rock: one quarter, to 40 m from the axis. Lengths in m.
SetFactory("Built-in");
DefineConstant[ size = 1.0 ];
R = 4; far = 40;
fine = 0.6 * size; coarse = 7 * size;

Point(1) = {0, 0, 0, 2 * fine};
Point(2) = {R, 0, 0, fine};
Point(3) = {0, R, 0, fine};
Point(4) = {far, 0, 0, coarse};
Point(5) = {far, far, 0, coarse};
Point(6) = {0, far, 0, coarse};

Line(1) = {1, 2};
Circle(2) = {2, 1, 3};
Line(3) = {3, 1};
Line(4) = {2, 4};
Line(5) = {4, 5};
Line(6) = {5, 6};
Line(7) = {6, 3};

Curve Loop(1) = {1, 2, 3};
Plane Surface(1) = {1};
Curve Loop(2) = {4, 5, 6, 7, -2};
Plane Surface(2) = {2};

Physical Surface("tunnel") = {1};
Physical Surface("rock") = {2};
Physical Curve("invert") = {1, 4};
Physical Curve("middle") = {3, 7};
Physical Curve("side") = {5};
Physical Curve("top") = {6};
