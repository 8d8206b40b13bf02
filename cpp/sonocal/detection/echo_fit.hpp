// The middle of an echo from its upper flank.
#pragma once

#include <vector>

namespace sonocal {

struct EchoPixel {
  double u, v, value;
};

struct EchoFit {
  bool found = false;
  double u, v;        // the paraboloid's top, less what the tail pulls it down by
  double deeper = 0;  // px below v: where the middle is if the tail opposes the echo; 0: as good as at v
  double uu, uv, vv;  // inverse of its curvature: px^2 a grey level
};

// A Gaussian pulse, logarithmically compressed, is a paraboloid of grey levels:
//   g(x) = g0 - (x - x0)^T C (x - x0)
// Reverberations follow along +v and pull the echo down. On the pixels with (x - x0)^T C e_v < 0 they are
// weakest, so that the paraboloid is fitted again to those and to a few beyond. Saturated pixels say nothing
// of its shape. An echo taller than the tail's period is one spot with it, whose middle depends on the phases
// with which they add; an image without phases does not tell them.
// unit: the image's finest scale, px.
EchoFit fit_echo(const std::vector<EchoPixel>& pixels, double contrast, double unit);

}  // namespace sonocal
