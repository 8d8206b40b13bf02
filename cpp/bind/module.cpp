#include "bind/arrays.hpp"
#include "sonocal/interrupt/interrupt.hpp"

namespace {

// Python's signal handlers run in its main thread only, and only when somebody asks.
void ask_python() {
  nb::gil_scoped_acquire lock;
  if (PyErr_CheckSignals() != 0) throw nb::python_error();
}

}  // namespace

NB_MODULE(_core, m) {
  m.doc() = "The mathematics of sonocal, in C++.";
  sonocal::on_interrupt(&ask_python);
  bind_solvers(m);
  bind_table(m);
  bind_estimate(m);
  bind_certificate(m);
  bind_noise(m);
  bind_places(m);
  bind_labels(m);
  bind_detection(m);
  bind_study(m);
  bind_igtl(m);
  bind_volumes(m);
  bind_plus(m);
}
