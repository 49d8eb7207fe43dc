// A rockfill dam 40 m high with a clay core, placed in four lifts on rock.
// x downstream from the axis, y upwards from the foundation, in m.

height = 40; lifts = 4;
crest = 4;   face = 1.8;   // half of the crest, and run of the faces per metre of height
core = 2.5;  batter = 0.25; // the same of the core
side = 160; depth = 60;    // of the foundation

fill = 4;  // size of the elements in the dam
edge = 15;   // and at the edges of the foundation

// Rows of four points: upstream face, core, core, downstream face.
For i In {0:lifts}
  y = height * i / lifts;
  outside = crest + face * (height - y);
  inside = core + batter * (height - y);
  p[4*i] = newp;   Point(p[4*i]) = {-outside, y, 0, fill};
  p[4*i+1] = newp; Point(p[4*i+1]) = {-inside, y, 0, fill};
  p[4*i+2] = newp; Point(p[4*i+2]) = { inside, y, 0, fill};
  p[4*i+3] = newp; Point(p[4*i+3]) = { outside, y, 0, fill};
  For k In {0:2}
    level[3*i+k] = newl; Line(level[3*i+k]) = {p[4*i+k], p[4*i+k+1]};
  EndFor
EndFor

// What is placed together is one physical surface.
For i In {0:lifts-1}
  For k In {0:3}
    rise[k] = newl; Line(rise[k]) = {p[4*i+k], p[4*i+4+k]};
  EndFor
  For k In {0:2}
    loop = newll; Curve Loop(loop) = {level[3*i+k], rise[k+1], -level[3*i+3+k], -rise[k]};
    zone[k] = news; Plane Surface(zone[k]) = {loop};
  EndFor
  Physical Surface(Sprintf("shell-%g", i + 1)) = {zone[0], zone[2]};
  Physical Surface(Sprintf("core-%g", i + 1)) = {zone[1]};
EndFor

a = newp; Point(a) = { side, 0, 0, edge};
b = newp; Point(b) = { side, -depth, 0, edge};
c = newp; Point(c) = {-side, -depth, 0, edge};
d = newp; Point(d) = {-side, 0, 0, edge};
ground[0] = newl; Line(ground[0]) = {d, p[0]};
ground[1] = newl; Line(ground[1]) = {p[3], a};
ground[2] = newl; Line(ground[2]) = {a, b};
ground[3] = newl; Line(ground[3]) = {b, c};
ground[4] = newl; Line(ground[4]) = {c, d};
loop = newll;
Curve Loop(loop) = {-ground[4], -ground[3], -ground[2], -ground[1], -level[2], -level[1], -level[0], -ground[0]};
foundation = news; Plane Surface(foundation) = {loop};
Physical Surface("foundation") = foundation;
Physical Curve("right") = ground[2];
Physical Curve("bottom") = ground[3];
Physical Curve("left") = ground[4];

Mesh.Algorithm = 6;
