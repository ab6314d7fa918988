// The error type of the whole project: a code for decisions and a text for logs. The table in
// docs/design.md lists what each code means for a poll and for a command.
#pragma once

#include <cstdint>
#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace fxagent {

enum class ErrorCode : std::uint8_t {
  timeout,      ///< no complete reply by the deadline
  link_down,    ///< the channel is closed or failed to open
  bad_frame,    ///< the reply has a wrong sum, length or shape
  unsupported,  ///< not possible with this protocol or model
  bad_request,  ///< unknown address, range or type; nothing was sent
};

struct Error {
  ErrorCode code = ErrorCode::bad_request;
  std::string text;  ///< human-readable: what, where, which value
};

template <class T>
using Result = tl::expected<T, Error>;

inline tl::unexpected<Error> fail(ErrorCode code, std::string text) {
  return tl::unexpected<Error>(Error{code, std::move(text)});
}

/// Passes on the error of a result of another type.
template <class T>
tl::unexpected<Error> fail(const Result<T>& failed) {
  return tl::unexpected<Error>(failed.error());
}

/// A request that cannot be sent.
inline tl::unexpected<Error> refuse(std::string text) {
  return fail(ErrorCode::bad_request, std::move(text));
}

/// An answer that breaks the rules of its protocol.
inline tl::unexpected<Error> garbled(std::string text) {
  return fail(ErrorCode::bad_frame, std::move(text));
}

}  // namespace fxagent
