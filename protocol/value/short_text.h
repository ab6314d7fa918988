// A text stored in 16 bytes: up to 15 characters in place, longer ones on the heap. A large plant
// has hundreds of thousands of names and addresses, and nearly all of them are short.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <concepts>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

namespace fxagent {

/// Changes only by assignment. Shorter than 4 GiB.
class ShortText final {
 public:
  static constexpr std::size_t kInPlace = 15;

  ShortText() = default;
  template <class Text>
  requires(std::convertible_to<const Text&, std::string_view> && !std::same_as<Text, ShortText>)
      ShortText(const Text& text) {  // NOLINT(google-explicit-constructor): one text for another
    set(text);
  }
  ShortText(const ShortText& other) { set(other); }
  ShortText(ShortText&& other) noexcept : bytes_(std::exchange(other.bytes_, {})) {}
  ShortText& operator=(ShortText other) noexcept {
    std::swap(bytes_, other.bytes_);
    return *this;
  }
  ~ShortText() {
    if (is_elsewhere()) delete[] elsewhere().text;
  }

  operator std::string_view() const {  // NOLINT(google-explicit-constructor): as std::string
    if (!is_elsewhere()) return {bytes_.data(), static_cast<std::size_t>(bytes_.back())};
    return {elsewhere().text, elsewhere().size};
  }
  bool empty() const { return bytes_.back() == 0; }

  friend bool operator==(const ShortText& a, const ShortText& b) {
    return std::string_view(a) == std::string_view(b);
  }
  template <class Text>
  requires(std::convertible_to<const Text&, std::string_view> &&
           !std::same_as<Text, ShortText>) friend bool
  operator==(const ShortText& a, const Text& b) {
    return std::string_view(a) == std::string_view(b);
  }
  friend std::string operator+(const ShortText& a, std::string_view b) {
    return std::string(a).append(b);
  }
  friend std::string operator+(std::string a, const ShortText& b) { return std::move(a.append(b)); }

 private:
  static constexpr char kElsewhere = kInPlace + 1;
  using InPlace = std::array<char, kInPlace + 1>;
  struct Elsewhere {
    char* text;
    std::uint32_t size;
    std::array<char, kInPlace - sizeof(char*) - sizeof(std::uint32_t)> unused;
    char mark;
  };

  bool is_elsewhere() const { return bytes_.back() == kElsewhere; }
  Elsewhere elsewhere() const { return std::bit_cast<Elsewhere>(bytes_); }
  /// Requires that `this` holds no text yet.
  void set(std::string_view text) {
    if (text.size() <= kInPlace) {
      std::ranges::copy(text, bytes_.begin());
      bytes_.back() = static_cast<char>(text.size());
      return;
    }
    const Elsewhere place{
        new char[text.size()], static_cast<std::uint32_t>(text.size()), {}, kElsewhere};
    std::ranges::copy(text, place.text);
    bytes_ = std::bit_cast<InPlace>(place);
  }

  // The text with its size in the last byte, or an Elsewhere with its mark in that byte.
  alignas(Elsewhere) InPlace bytes_{};
};

}  // namespace fxagent
