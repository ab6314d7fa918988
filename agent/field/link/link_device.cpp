#include "agent/field/link/link_device.h"

#include <algorithm>
#include <chrono>

#include "agent/log/log.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;

// Limits the log of a device that gives ever new reasons.
constexpr std::size_t kMostLogged = 8;

// Foreign bytes are examined at most this often, and each cause is logged again after this long.
constexpr std::chrono::seconds kUnexpectedBytesEvery{10};
constexpr std::chrono::hours kUnexpectedBytesLoggedEvery{24};

}  // namespace

void LinkDevice::log_refusal_once(const std::string& reason) {
  if (logged_refusals.size() >= kMostLogged) return;
  if (std::ranges::find(logged_refusals, reason) != logged_refusals.end()) return;
  logged_refusals.push_back(reason);
  log::warn("device",
            {{"device", config.name}, {"refused", "what it is asked"}, {"reason", reason}});
}

void LinkDevice::log_foreign_bytes(const Exchange& exchange) {
  const auto now = Clock::now();
  if (exchange.received.empty() || now < unexpected_bytes_from) return;
  unexpected_bytes_from = now + kUnexpectedBytesEvery;
  if (now - causes_logged_since >= kUnexpectedBytesLoggedEvery) {
    logged_causes.reset();
    causes_logged_since = now;
  }
  const UnexpectedBytes guess = looks_like(config, *codec, exchange.asked, exchange.received);
  const auto cause = static_cast<std::size_t>(guess.cause);
  if (logged_causes.test(cause)) return;
  logged_causes.set(cause);
  log::warn("device", {{"device", config.name},
                       {"heard", first_bytes(exchange.received)},
                       {"reason", exchange.error},
                       {"looks_like", guess.text}});
}

}  // namespace fxagent
