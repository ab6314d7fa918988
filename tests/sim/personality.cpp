#include "tests/sim/personality.h"

namespace fxsim {

std::string request_kind_name(RequestKind kind) {
  switch (kind) {
    case RequestKind::read:
      return "read";
    case RequestKind::write:
      return "write";
    case RequestKind::force_on:
      return "force_on";
    case RequestKind::force_off:
      return "force_off";
    case RequestKind::enquire:
      return "enq";
    case RequestKind::other:
      return "other";
    case RequestKind::malformed:
      return "malformed";
  }
  return {};
}

std::string verdict_name(Verdict verdict) {
  switch (verdict) {
    case Verdict::data:
      return "data";
    case Verdict::ack:
      return "ack";
    case Verdict::nak:
      return "nak";
    case Verdict::silent:
      return "silent";
  }
  return {};
}

}  // namespace fxsim
