#include "cli/stop_request.h"

#include <csignal>

namespace forcegrid::cli {
namespace {

std::atomic<int> requests{0};
std::atomic<bool> stop_flag{false};
std::atomic<bool> hurry_flag{false};
std::atomic<bool> main_part_over{false};
static_assert(std::atomic<int>::is_always_lock_free && std::atomic<bool>::is_always_lock_free);

void on_signal(int /*signal*/) { StopRequest::request(); }

}  // namespace

void StopRequest::install() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigemptyset(&action.sa_mask);
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    sigaction(number, &action, nullptr);
  }
  std::signal(SIGPIPE, SIG_IGN);
}

const std::atomic<bool>& StopRequest::stop() noexcept { return stop_flag; }

const std::atomic<bool>& StopRequest::hurry() noexcept { return hurry_flag; }

void StopRequest::request() noexcept {
  if (requests.fetch_add(1) > 0 || main_part_over.load()) {
    hurry_flag.store(true);
  }
  stop_flag.store(true);
}

void StopRequest::main_part_is_over() noexcept { main_part_over.store(true); }

}  // namespace forcegrid::cli
