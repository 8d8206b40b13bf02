// Long work asks now and then whether somebody wants it to end.
#pragma once

#include <atomic>

namespace sonocal {

// Called by the thread that asked for the work, some twenty times a second; throws what ends it.
using Ask = void (*)();
void on_interrupt(Ask ask);

// Between pieces of work. Throws what `Ask` throws, or `Stopped` in a thread that helps with the work.
void allow_interrupt();

struct Stopped {};

// While it lives, this thread is a helper: it ends when `stop` is set, and asks nobody.
class Helping {
 public:
  explicit Helping(const std::atomic<bool>& stop);
  ~Helping();
  Helping(const Helping&) = delete;
  Helping& operator=(const Helping&) = delete;
};

}  // namespace sonocal
