// The one error type of the project: a code for a decision, words for a log.
// What each code means to a poll and to a command is the table in agent/README.md.
#pragma once

#include <cstdint>
#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace fxagent {

enum class ErrorCode : std::uint8_t {
  timeout,      ///< no whole reply by the deadline
  link_down,    ///< the channel is closed or would not open
  bad_frame,    ///< a reply came and is wrong: sum, length, shape
  refused,      ///< the device answered no; it is alive
  unsupported,  ///< this protocol or this model cannot say it
  bad_request,  ///< unknown address, range, type: nothing was sent
  expired,      ///< too old to be sent
};

struct Error {
  ErrorCode code = ErrorCode::bad_request;
  std::string text;     ///< for a person: what, where, which value
  int device_code = 0;  ///< the reason a device gave with its refusal; 0 where it gives none
};

template <class T>
using Result = tl::expected<T, Error>;

inline tl::unexpected<Error> fail(ErrorCode code, std::string text, int device_code = 0) {
  return tl::unexpected<Error>(Error{code, std::move(text), device_code});
}

}  // namespace fxagent
