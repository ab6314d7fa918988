// Converts files of other programs to UTF-8.
#include <iconv.h>

#include <array>
#include <cerrno>
#include <memory>

#include "agent/import/formats.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

/// Appends the text in UTF-8. Returns false if the bytes are invalid in the encoding.
bool convert(iconv_t converter, std::string_view bytes, std::string& out) {
  std::string copy(bytes);  // iconv() takes a non-const pointer but does not modify the text
  char* in = copy.data();
  std::size_t in_left = copy.size();
  std::array<char, 4096> block{};
  while (in_left > 0) {
    char* to = block.data();
    std::size_t room = block.size();
    const std::size_t done = iconv(converter, &in, &in_left, &to, &room);
    out.append(block.data(), block.size() - room);
    if (done == static_cast<std::size_t>(-1) && errno != E2BIG) return false;
  }
  return true;
}

/// True if, from `first` on, most alternate bytes at the start of the text are zero.
bool has_zeros_at(std::string_view bytes, std::size_t first) {
  const std::string_view head = bytes.substr(0, 256);
  std::size_t zeros = 0;
  for (std::size_t i = first; i < head.size(); i += 2) zeros += head[i] == '\0' ? 1U : 0U;
  return head.size() >= 4 && zeros * 4 > head.size() / 2;
}

/// Returns UTF-8 or UTF-16 by byte order mark, zero bytes or valid UTF-8; nullptr: none of them.
const char* unicode_of(std::string_view bytes) {
  using std::string_view_literals::operator""sv;
  if (bytes.starts_with("\xFF\xFE"sv)) return "UTF-16LE";
  if (bytes.starts_with("\xFE\xFF"sv)) return "UTF-16BE";
  if (has_zeros_at(bytes, 1)) return "UTF-16LE";
  if (has_zeros_at(bytes, 0)) return "UTF-16BE";
  return is_utf8(bytes) ? "UTF-8" : nullptr;
}

}  // namespace

bool is_unicode(std::string_view bytes) { return unicode_of(bytes) != nullptr; }

tl::expected<std::string, std::string> to_utf8(std::string_view bytes, const char* legacy) {
  constexpr std::string_view kMark = "\xEF\xBB\xBF";
  if (bytes.starts_with(kMark)) bytes.remove_prefix(kMark.size());
  const char* unicode = unicode_of(bytes);
  const char* encoding = unicode != nullptr ? unicode : legacy;
  const iconv_t converter = iconv_open("UTF-8", encoding);
  if (converter == reinterpret_cast<iconv_t>(-1))
    return tl::unexpected("the C library of this machine cannot convert " + std::string(encoding) +
                          ": convert the file to UTF-8");
  const std::unique_ptr<void, int (*)(iconv_t)> owner(converter, iconv_close);
  std::string out;
  if (!convert(converter, bytes, out) || !is_utf8(out))
    return tl::unexpected("is neither UTF-8 nor " + std::string(encoding));
  if (unicode != nullptr && out.starts_with(kMark)) out.erase(0, kMark.size());
  return out;
}

}  // namespace fxagent
