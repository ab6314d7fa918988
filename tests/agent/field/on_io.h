// Runs coroutines of the field to completion, as the field thread would.
#pragma once

#include <gtest/gtest.h>

#include <asio/awaitable.hpp>
#include <asio/co_spawn.hpp>
#include <asio/io_context.hpp>
#include <chrono>
#include <exception>

namespace fxagent::test {

/// A generous limit for operations of a few milliseconds. Reaching it is a failure, not a
/// measurement.
inline constexpr std::chrono::seconds kLimit{20};

/// Runs `task` and returns its result. `T` must be default-constructible.
template <class T>
T run_on(asio::io_context& io, asio::awaitable<T> task) {
  std::optional<T> outcome;
  asio::co_spawn(io, std::move(task), [&outcome](std::exception_ptr bug, T result) {
    if (bug) std::rethrow_exception(bug);
    outcome = std::move(result);
  });
  io.restart();
  const auto give_up = std::chrono::steady_clock::now() + kLimit;
  while (!outcome && std::chrono::steady_clock::now() < give_up) io.run_one_until(give_up);
  if (outcome) return std::move(*outcome);
  ADD_FAILURE() << "the coroutine did not end";
  return T();
}

inline void run_on(asio::io_context& io, asio::awaitable<void> task) {
  run_on(io, [](asio::awaitable<void> of) -> asio::awaitable<bool> {
    co_await std::move(of);
    co_return true;
  }(std::move(task)));
}

/// Runs events until `reached` returns true. Reports a failure if it never does.
inline void run_until(asio::io_context& io, const std::function<bool()>& reached) {
  io.restart();
  const auto give_up = std::chrono::steady_clock::now() + kLimit;
  while (!reached()) {
    if (std::chrono::steady_clock::now() >= give_up) {
      ADD_FAILURE() << "what the test waits for did not come";
      return;
    }
    if (io.run_one_until(give_up) == 0) io.restart();
  }
}

}  // namespace fxagent::test
