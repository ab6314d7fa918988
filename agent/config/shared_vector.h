// List whose copies share all elements: copying it copies one pointer. Changing one copy first
// gives it elements of its own (copy on write).
#pragma once

#include <cstddef>
#include <initializer_list>
#include <memory>
#include <utility>
#include <vector>

namespace fxagent {

/// Several threads may read copies. Non-const access copies shared elements, so access a list
/// that other threads read through const only. References stay valid as long as any copy has the
/// elements.
template <class T>
class SharedVector final {
  using Elements = std::vector<T>;

 public:
  using value_type = T;
  using iterator = typename Elements::iterator;
  using const_iterator = typename Elements::const_iterator;

  SharedVector() = default;
  SharedVector(std::initializer_list<T> list) : elements_(std::make_shared<Elements>(list)) {}

  std::size_t size() const { return all().size(); }
  bool empty() const { return all().empty(); }
  const T& operator[](std::size_t i) const { return all()[i]; }
  const T& at(std::size_t i) const { return all().at(i); }
  const T& front() const { return all().front(); }
  const T& back() const { return all().back(); }
  const_iterator begin() const { return all().begin(); }
  const_iterator end() const { return all().end(); }
  /// True if both have the same elements in memory, not merely equal ones.
  bool shares(const SharedVector& other) const { return elements_ == other.elements_; }
  friend bool operator==(const SharedVector& a, const SharedVector& b) {
    return a.shares(b) || a.all() == b.all();
  }

  T& operator[](std::size_t i) { return own()[i]; }
  T& at(std::size_t i) { return own().at(i); }
  T& front() { return own().front(); }
  T& back() { return own().back(); }
  iterator begin() { return own().begin(); }
  iterator end() { return own().end(); }

  void reserve(std::size_t size) { own().reserve(size); }
  void push_back(T element) { own().push_back(std::move(element)); }
  T& emplace_back() { return own().emplace_back(); }
  void pop_back() { own().pop_back(); }
  void clear() { elements_.reset(); }
  void resize(std::size_t size) { own().resize(size); }
  void assign(std::size_t size, const T& like) { own().assign(size, like); }

 private:
  const Elements& all() const {
    static const Elements none;
    return elements_ == nullptr ? none : *elements_;
  }
  Elements& own() {
    if (elements_ == nullptr)
      elements_ = std::make_shared<Elements>();
    else if (elements_.use_count() > 1)
      elements_ = std::make_shared<Elements>(*elements_);
    return *elements_;
  }

  std::shared_ptr<Elements> elements_;  ///< owners: all copies; nullptr if empty
};

}  // namespace fxagent
