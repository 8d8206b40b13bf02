// The middle of an echo from its upper flank.
#pragma once

#include <vector>

namespace sonocal {

struct EchoPixel {
  double u, v, value;
};

struct EchoFit {
  bool found = false;
  double u, v;        // the paraboloid's top
  double uu, uv, vv;  // inverse of its curvature: px^2 a grey level
};

// A Gaussian pulse, logarithmically compressed, is a paraboloid of grey levels:
//   g(x) = g0 - (x - x0)^T C (x - x0)
// Reverberations follow along +v and pull the echo down. On the pixels with (x - x0)^T C e_v < 0 they are
// weakest, so that the paraboloid is fitted again to those and to a few beyond. Saturated pixels say nothing
// of its shape.
EchoFit fit_echo(const std::vector<EchoPixel>& pixels, double contrast);

}  // namespace sonocal
