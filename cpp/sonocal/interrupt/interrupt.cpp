#include "sonocal/interrupt/interrupt.hpp"

#include <chrono>

namespace sonocal {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kEvery{50};  // whoever presses ctrl-C waits no longer

std::atomic<Ask> asked{nullptr};
thread_local Clock::time_point next{};
thread_local const std::atomic<bool>* stopped = nullptr;

}  // namespace

void on_interrupt(Ask ask) { asked = ask; }

void allow_interrupt() {
  if (stopped != nullptr) {
    if (*stopped) throw Stopped{};
    return;
  }
  const Clock::time_point now = Clock::now();
  if (now < next) return;
  next = now + kEvery;
  if (const Ask ask = asked) ask();
}

Helping::Helping(const std::atomic<bool>& stop) { stopped = &stop; }
Helping::~Helping() { stopped = nullptr; }

}  // namespace sonocal
