#include "protocol/mc/serial_frame.h"

#include <algorithm>
#include <string_view>

#include "protocol/mc/body.h"

namespace fxagent::mc {
namespace {

constexpr std::uint8_t k3C = 0xF9;
constexpr std::uint8_t k4C = 0xF8;
constexpr std::size_t kBlock = 2;
constexpr std::size_t kSum = 2;
constexpr std::size_t kEnd = 2;  // CR LF
constexpr std::string_view kDone = "QACK";
constexpr std::string_view kRefused = "QNAK";
// Format 5: length, the mark FFFF of an answer, end code.
constexpr std::size_t kLength = 2;
constexpr std::size_t kMark = 2;

/// Returns block number, frame id and route: all that stands between the control character and the
/// content of an answer.
Bytes head_of(const Dialect& dialect, std::uint8_t block) {
  Bytes head;
  if (dialect.format == 2) append_hex(head, block, 2);
  const Bytes header = serial_header(dialect);
  head.insert(head.end(), header.begin(), header.end());
  return head;
}

std::size_t head_size(const Dialect& dialect) {
  return serial_header(dialect).size() + (dialect.format == 2 ? kBlock : 0);
}

std::size_t tail_size(const Dialect& dialect) { return dialect.format == 4 ? kEnd : 0; }

std::size_t sum_size(const Dialect& dialect) { return dialect.sum_check ? kSum : 0; }

void append_doubled(Bytes& out, ByteView bytes) {
  for (const std::uint8_t byte : bytes) {
    out.push_back(byte);
    if (byte == kDle) out.push_back(kDle);
  }
}

std::size_t doubles(ByteView bytes) {
  return static_cast<std::size_t>(std::count(bytes.begin(), bytes.end(), kDle));
}

/// Returns length and route of a frame with `rest` characters after them, before doubling.
Bytes binary_head(const Dialect& dialect, std::size_t rest) {
  Bytes head;
  const Bytes header = serial_header(dialect);
  append_number(Code::binary, head, static_cast<std::uint32_t>(header.size() + rest), kLength);
  head.insert(head.end(), header.begin(), header.end());
  return head;
}

/// Returns the head of an answer with `data` characters, before doubling.
Bytes binary_answer_head(const Dialect& dialect, std::size_t data) {
  return binary_head(dialect, kMark + kEndCode + data);
}

Bytes binary_request(const Dialect& dialect, ByteView message) {
  Bytes content = binary_head(dialect, message.size());
  content.insert(content.end(), message.begin(), message.end());
  Bytes frame{kDle, kStx};
  append_doubled(frame, content);
  frame.insert(frame.end(), {kDle, kEtx});
  if (dialect.sum_check) append_hex(frame, byte_sum(content), 2);
  return frame;
}

/// Searches the received bytes for an answer in formats 1 to 4.
class AsciiSearch final {
 public:
  AsciiSearch(const Dialect& dialect, std::uint8_t block, std::size_t data, ByteView rx)
      : dialect_(dialect), head_(head_of(dialect, block)), data_(data), rx_(rx) {}

  Decoded run() {
    // A PLC never sends ENQ: it is the echo of the request, and bytes before it are older. In
    // format 3 requests begin with STX and are recognised by the text after their head.
    if (!is_3())
      for (std::size_t i = rx_.size(); i > 0 && at_ == 0; --i)
        if (rx_[i - 1] == kEnq) at_ = i;
    while (at_ < rx_.size()) {
      const std::uint8_t first = rx_[at_];
      const bool begins = first == kStx || (!is_3() && (first == kAck || first == kNak));
      if (!begins) {
        ++at_;
        continue;
      }
      if (first == kStx && begins_anew()) continue;
      if (auto answer = judge(first)) return std::move(*answer);
    }
    return std::nullopt;
  }

 private:
  bool is_1c() const { return dialect_.frame == Frame::c1; }
  bool is_3() const { return dialect_.format == 3; }
  std::size_t left() const { return rx_.size() - at_; }
  static Decoded incomplete() { return std::nullopt; }

  /// If another STX cuts off a frame, continues at that STX.
  bool begins_anew() {
    const auto from = rx_.begin() + static_cast<std::ptrdiff_t>(at_) + 1;
    const auto again =
        std::find_if(from, rx_.end(), [](std::uint8_t c) { return c == kStx || c == kEtx; });
    if (again == rx_.end() || *again == kEtx) return false;
    at_ = static_cast<std::size_t>(again - rx_.begin());
    return true;
  }

  bool is_ours() const {
    const auto same = [](std::uint8_t a, std::uint8_t b) {
      return a == b || (hex_digit(a) >= 0 && hex_digit(a) == hex_digit(b));
    };
    return std::ranges::equal(head_, rx_.subspan(at_ + 1, head_.size()), same);
  }

  /// Returns nullopt if no answer began here; `at_` is then after it. Returns an incomplete answer
  /// if more bytes are needed.
  std::optional<Decoded> judge(std::uint8_t first) {
    if (left() < 1 + head_.size()) return incomplete();
    const bool ours = is_ours();
    if (first == kStx) {
      if (!ours) return pass_frame();
      return is_3() ? judge_3() : (data_ == 0 ? pass_frame() : data_from(0));
    }
    if (!ours || (first == kAck && data_ != 0)) {
      ++at_;
      return std::nullopt;
    }
    return first == kAck ? finish(Reply::Kind::ack, 1 + head_.size(), 0)
                         : refused_at(1 + head_.size(), 0);
  }

  std::optional<Decoded> judge_3() {
    const std::size_t word = 1 + head_.size();
    if (left() < word + kDone.size()) return incomplete();
    const std::string said = as_text(rx_.subspan(at_ + word, kDone.size()));
    if (said == kRefused) return refused_at(word + kRefused.size(), 1);
    if (said != kDone) return pass_frame();  // echo of the request
    const std::size_t behind = word + kDone.size();
    if (left() <= behind) return incomplete();
    const bool has_data = rx_[at_ + behind] != kEtx;
    if (has_data != (data_ != 0)) return pass_frame();
    return has_data ? data_from(kDone.size()) : finish(Reply::Kind::ack, behind, 1);
  }

  /// Completes an answer without data: `size` characters, ETX if any, then CR LF.
  std::optional<Decoded> finish(Reply::Kind kind, std::size_t size, std::size_t etx,
                                std::uint32_t code = 0) {
    const std::size_t whole = size + etx + tail_size(dialect_);
    if (left() < whole) return incomplete();
    if (etx != 0 && rx_[at_ + size] != kEtx) return garbled("ETX is missing after the answer");
    if (!has_tail(whole)) return no_tail(is_1c() ? "ACK or NAK" : "the answer");
    return Decoded(Reply{.kind = kind,
                         .device_code = static_cast<int>(code),
                         .began = at_,
                         .consumed = at_ + whole});
  }

  /// The codec of 1C reads its code of two digits again.
  std::optional<Decoded> refused_at(std::size_t size, std::size_t etx) {
    const std::size_t digits = is_1c() ? 2 : 4;
    if (left() < size + digits) return incomplete();
    const ByteView given = rx_.subspan(at_ + size, digits);
    const auto code = number_in(NumberForm::digits, given);
    if (!code && !is_1c())
      return garbled("refused with the code " + to_hex(given) + ", which is not four hex digits");
    return finish(Reply::Kind::nak, size + digits, etx, code.value_or(0));
  }

  /// Decodes an answer with data. `word` characters precede the data after the head.
  std::optional<Decoded> data_from(std::size_t word) {
    const std::size_t begin = 1 + head_.size() + word;
    const std::size_t etx = begin + data_;
    const std::size_t whole = etx + 1 + sum_size(dialect_) + tail_size(dialect_);
    const ByteView frame = rx_.subspan(at_, std::min(whole, left()));
    const auto found = static_cast<std::size_t>(
        std::find(frame.begin() + static_cast<std::ptrdiff_t>(std::min(begin, frame.size())),
                  frame.end(), kEtx) -
        frame.begin());
    if (found < etx && found < frame.size())
      return garbled(std::to_string(found - begin) + " data characters given, " +
                     std::to_string(data_) + " expected");
    if (found != etx && frame.size() > etx)
      return garbled("more data characters given, " + std::to_string(data_) + " expected");
    if (frame.size() < whole) return incomplete();
    if (dialect_.sum_check)
      if (auto why = why_wrong_sum(frame.subspan(etx + 1, kSum), frame.subspan(1, etx));
          !why.empty())
        return garbled(std::move(why));
    if (!has_tail(whole)) return no_tail(is_1c() ? "the data" : "the answer");
    const ByteView data = frame.subspan(begin, data_);
    return Decoded(Reply{.kind = Reply::Kind::data,
                         .image = Bytes(data.begin(), data.end()),
                         .began = at_,
                         .consumed = at_ + whole});
  }

  /// Skips a frame with STX that is not the wanted answer. Incomplete if its end has not arrived.
  std::optional<Decoded> pass_frame() {
    const auto begin = rx_.begin() + static_cast<std::ptrdiff_t>(at_);
    const auto etx = std::find(begin, rx_.end(), kEtx);
    if (etx == rx_.end()) return incomplete();
    const std::string content(begin + 1, etx);
    const std::string said = content.substr(std::min(head_.size(), content.size()));
    // QACK without data, and QNAK, have no sum.
    const bool plain = is_3() && (said == kDone || said.starts_with(kRefused));
    const std::size_t end =
        static_cast<std::size_t>(etx - rx_.begin()) + 1 + (plain ? 0 : sum_size(dialect_));
    if (end > rx_.size()) return incomplete();
    at_ = end;
    return std::nullopt;
  }

  bool has_tail(std::size_t whole) const {
    return tail_size(dialect_) == 0 || (rx_[at_ + whole - 2] == kCr && rx_[at_ + whole - 1] == kLf);
  }
  static tl::unexpected<Error> no_tail(std::string_view after) {
    return garbled("CR LF is missing after " + std::string(after) + ": format 4 ends with it");
  }

  const Dialect& dialect_;
  Bytes head_;
  std::size_t data_;
  ByteView rx_;
  std::size_t at_ = 0;
};

/// Interprets a whole frame of format 5. Returns nullopt if it is not the answer to this request.
std::optional<Decoded> binary_answer(const Dialect& dialect, std::size_t data, ByteView content) {
  const Bytes header = serial_header(dialect);
  const std::size_t least = kLength + header.size() + kMark + kEndCode;
  if (content.size() < kLength + header.size() ||
      !std::ranges::equal(header, content.subspan(kLength, header.size())))
    return std::nullopt;
  const std::size_t length = *number_at(Code::binary, content, 0, kLength);
  if (length != content.size() - kLength)
    return garbled("length " + std::to_string(length) + " given, " +
                   std::to_string(content.size() - kLength) + " bytes received");
  const std::size_t mark = kLength + header.size();
  if (content.size() < mark + kMark || content[mark] != 0xFF || content[mark + 1] != 0xFF)
    return std::nullopt;  // echo of a request
  if (content.size() < least) return garbled("an answer without end code");
  const auto code = static_cast<int>(*number_at(Code::binary, content, mark + kMark, kEndCode));
  const ByteView rest = content.subspan(least);
  if (code != 0) return Decoded(Reply{.kind = Reply::Kind::nak, .device_code = code});
  if ((rest.empty()) != (data == 0))
    return std::nullopt;  // a late answer to a request of the other kind
  if (rest.size() != data)
    return garbled(std::to_string(rest.size()) + " bytes of data given, " + std::to_string(data) +
                   " expected");
  return Decoded(Reply{.kind = data == 0 ? Reply::Kind::ack : Reply::Kind::data,
                       .image = Bytes(rest.begin(), rest.end())});
}

Decoded binary_search(const Dialect& dialect, std::size_t data, ByteView rx) {
  std::size_t at = 0;
  while (at + 1 < rx.size()) {
    if (rx[at] != kDle || rx[at + 1] != kStx) {
      ++at;
      continue;
    }
    const Undoubled frame = undoubled(rx, at);
    if (frame.state == Undoubled::State::incomplete) return std::nullopt;
    if (frame.state == Undoubled::State::wrong) {
      at = frame.end;
      continue;
    }
    const std::size_t end = frame.end + sum_size(dialect);
    if (rx.size() < end) return std::nullopt;
    if (dialect.sum_check)
      if (auto why = why_wrong_sum(rx.subspan(frame.end, kSum), frame.content); !why.empty())
        return garbled(std::move(why));
    if (auto answer = binary_answer(dialect, data, frame.content)) {
      if (Decoded& reply = *answer) {
        (*reply)->began = at;
        (*reply)->consumed = end;
      }
      return std::move(*answer);
    }
    at = end;
  }
  return std::nullopt;
}

}  // namespace

Bytes serial_header(const Dialect& dialect) {
  Bytes header;
  const Code code = dialect.code;
  const bool is_1c = dialect.frame == Frame::c1;
  if (!is_1c) append_number(code, header, dialect.frame == Frame::c4 ? k4C : k3C, 1);
  append_number(code, header, dialect.station, 1);
  if (!is_1c) append_number(code, header, dialect.route.network, 1);
  append_number(code, header, dialect.route.pc, 1);
  if (is_1c) return header;
  if (dialect.frame == Frame::c4) {
    append_number(code, header, dialect.route.module_io, 2);
    append_number(code, header, dialect.route.module_station, 1);
  }
  append_number(code, header, 0, 1);  // self-station: 0 except on m:n links
  return header;
}

Bytes serial_request(const Dialect& dialect, std::uint8_t block, ByteView message) {
  if (dialect.format == 5) return binary_request(dialect, message);
  Bytes frame{dialect.format == 3 ? kStx : kEnq};
  const Bytes head = head_of(dialect, block);
  frame.reserve(1 + head.size() + message.size() + 5);
  frame.insert(frame.end(), head.begin(), head.end());
  frame.insert(frame.end(), message.begin(), message.end());
  if (dialect.format == 3) frame.push_back(kEtx);
  if (dialect.sum_check) append_hex(frame, byte_sum(ByteView(frame).subspan(1)), 2);
  if (dialect.format == 4) frame.insert(frame.end(), {kCr, kLf});
  return frame;
}

std::size_t serial_answer_length(const Dialect& dialect, std::size_t data) {
  const std::size_t sum = sum_size(dialect);
  if (dialect.format == 5) {
    const Bytes head = binary_answer_head(dialect, data);
    return 2 + head.size() + doubles(head) + kMark + kEndCode + data + 2 + sum;
  }
  const std::size_t said = dialect.format == 3 ? kDone.size() : 0;
  const std::size_t etx = dialect.format == 3 || data != 0 ? 1 : 0;
  return 1 + head_size(dialect) + said + data + etx + (data != 0 ? sum : 0) + tail_size(dialect);
}

std::size_t serial_doubles(const Dialect& dialect, ByteView request, std::size_t data) {
  if (dialect.format != 5) return 0;
  // DLE STX and DLE ETX each add a DLE that is not doubled.
  return (doubles(request) - 2) / 2 + doubles(binary_answer_head(dialect, data));
}

Decoded serial_answer(const Dialect& dialect, std::uint8_t block, std::size_t data, ByteView rx) {
  if (dialect.format == 5) return binary_search(dialect, data, rx);
  return AsciiSearch(dialect, block, data, rx).run();
}

bool may_be_serial_answer(const Dialect& dialect, ByteView bytes) {
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    const ByteView rest = bytes.subspan(at + 1);
    if (dialect.format == 5) {
      if (bytes[at] == kDle && (rest.empty() || rest[0] == kStx)) return true;
      continue;
    }
    if (bytes[at] != kStx && bytes[at] != kAck && bytes[at] != kNak && bytes[at] != kEnq) continue;
    // Digits must follow, as far as they have arrived.
    const ByteView head = rest.first(std::min(rest.size(), head_size(dialect)));
    if (is_hex(head)) return true;
  }
  return false;
}

Undoubled undoubled(ByteView rx, std::size_t at) {
  Undoubled frame;
  for (std::size_t i = at + 2; i < rx.size(); ++i) {
    if (rx[i] != kDle) {
      frame.content.push_back(rx[i]);
      continue;
    }
    if (i + 1 == rx.size()) return frame;
    if (rx[i + 1] == kDle) {
      frame.content.push_back(kDle);
      ++i;
      continue;
    }
    const bool ends = rx[i + 1] == kEtx;
    frame.state = ends ? Undoubled::State::good : Undoubled::State::wrong;
    frame.end = ends ? i + 2 : i;
    return frame;
  }
  return frame;
}

}  // namespace fxagent::mc
