#include "bind/arrays.hpp"

NB_MODULE(_core, m) {
  m.doc() = "The mathematics of sonocal, in C++.";
  bind_solvers(m);
  bind_table(m);
  bind_estimate(m);
  bind_noise(m);
  bind_detection(m);
  bind_study(m);
}
