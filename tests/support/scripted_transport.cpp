#include "tests/support/scripted_transport.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <asio/post.hpp>
#include <asio/use_awaitable.hpp>

#include "agent/field/transport/stream_io.h"

namespace fxagent::test {

ScriptedTransport::ScriptedTransport(asio::any_io_executor executor)
    : executor_(executor), hanging_(executor) {}

ScriptedTransport& ScriptedTransport::add(Step step) {
  steps_.push_back(std::move(step));
  return *this;
}

ScriptedTransport& ScriptedTransport::expect(Bytes bytes) {
  return add({Step::Kind::expect, std::move(bytes), 0, "", {}});
}
ScriptedTransport& ScriptedTransport::give(Bytes bytes) {
  return add({Step::Kind::give, std::move(bytes), 0, "", {}});
}
ScriptedTransport& ScriptedTransport::later(Bytes bytes) {
  return add({Step::Kind::later, std::move(bytes), 0, "", {}});
}
ScriptedTransport& ScriptedTransport::silence() {
  return add({Step::Kind::silence, {}, 0, "", {}});
}
ScriptedTransport& ScriptedTransport::hang() { return add({Step::Kind::hang, {}, 0, "", {}}); }
ScriptedTransport& ScriptedTransport::hang_up() {
  return add({Step::Kind::hang_up, {}, 0, "", {}});
}
ScriptedTransport& ScriptedTransport::break_write(std::size_t after) {
  return add({Step::Kind::break_write, {}, after, "", {}});
}
ScriptedTransport& ScriptedTransport::refuse_open(std::string why) {
  return add({Step::Kind::refuse_open, {}, 0, std::move(why), {}});
}
ScriptedTransport& ScriptedTransport::call(std::function<void()> action) {
  return add({Step::Kind::call, {}, 0, "", std::move(action)});
}

ScriptedTransport::Step ScriptedTransport::take() {
  Step step = std::move(steps_.front());
  steps_.pop_front();
  return step;
}

bool ScriptedTransport::next_is(Step::Kind kind) {
  while (!steps_.empty() && steps_.front().kind == Step::Kind::call) {
    const Step step = take();
    step.action();
  }
  return !steps_.empty() && steps_.front().kind == kind;
}

asio::awaitable<Result<void>> ScriptedTransport::open(SteadyTime /*deadline*/) {
  co_await asio::post(executor_, asio::use_awaitable);
  close();
  arrived_.clear();
  ++opened_;
  if (next_is(Step::Kind::refuse_open)) {
    const Step step = take();
    co_return fail(ErrorCode::link_down, step.text);
  }
  open_ = true;
  co_return Result<void>{};
}

asio::awaitable<Transport::Written> ScriptedTransport::write(ByteView bytes,
                                                             SteadyTime /*deadline*/) {
  co_await asio::post(executor_, asio::use_awaitable);
  Written written;
  if (!open_) {
    written.error = Error{ErrorCode::link_down, "the scripted channel is closed"};
    co_return written;
  }
  if (next_is(Step::Kind::hang_up)) {
    take();
    written.error = Error{ErrorCode::link_down, "the scripted peer has gone"};
    co_return written;
  }
  if (next_is(Step::Kind::break_write)) {
    written.sent = std::min(take().count, bytes.size());
    written.error = Error{ErrorCode::link_down, "the scripted channel broke"};
    co_return written;
  }
  written_.emplace_back(bytes.begin(), bytes.end());
  written.sent = bytes.size();
  if (next_is(Step::Kind::expect)) {
    const Step step = take();
    EXPECT_EQ(to_hex(bytes), to_hex(step.bytes)) << "write number " << written_.size();
  } else if (steps_.empty() && device_) {
    const Bytes answer = device_(bytes);
    arrived_.insert(arrived_.end(), answer.begin(), answer.end());
  } else {
    ADD_FAILURE() << "not in the script: write number " << written_.size() << ", " << to_hex(bytes);
  }
  co_return written;
}

asio::awaitable<Result<std::size_t>> ScriptedTransport::read_some(MutableBytes into,
                                                                  SteadyTime deadline) {
  co_await asio::post(executor_, asio::use_awaitable);
  if (!open_) co_return fail(ErrorCode::link_down, "the scripted channel is closed");
  if (arrived_.empty() && (next_is(Step::Kind::give) || next_is(Step::Kind::later)))
    arrived_ = take().bytes;
  if (!arrived_.empty()) {
    const std::size_t count = std::min(into.size(), arrived_.size());
    const auto end = arrived_.begin() + static_cast<std::ptrdiff_t>(count);
    std::copy(arrived_.begin(), end, into.begin());
    arrived_.erase(arrived_.begin(), end);
    co_return count;
  }
  if (next_is(Step::Kind::hang_up)) {
    take();
    co_return fail(ErrorCode::link_down, "the scripted peer has gone");
  }
  if (next_is(Step::Kind::hang)) {
    take();
    hanging_.expires_at(deadline);
    co_await hanging_.async_wait(use_result);
    if (!open_) co_return fail(ErrorCode::link_down, "the scripted channel was closed");
  } else if (next_is(Step::Kind::silence)) {
    take();
  }
  co_return fail(ErrorCode::timeout, "nothing in the script");
}

Result<Bytes> ScriptedTransport::discard_input() {
  if (!open_) return fail(ErrorCode::link_down, "the scripted channel is closed");
  Bytes found = std::exchange(arrived_, {});
  while (next_is(Step::Kind::give)) {
    const Bytes bytes = take().bytes;
    found.insert(found.end(), bytes.begin(), bytes.end());
  }
  if (next_is(Step::Kind::hang_up)) {
    take();
    close();
    return fail(ErrorCode::link_down, "the scripted peer has gone");
  }
  return found;
}

void ScriptedTransport::close() noexcept {
  open_ = false;
  hanging_.cancel();
}

}  // namespace fxagent::test
