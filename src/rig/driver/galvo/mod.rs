//! Galvo mirrors on an analog output card: conversion of degrees to volts, moves as buffers of
//! samples, and settling.

pub mod scanner;
pub mod wiring;

#[cfg(test)]
mod tests;
